"""Recorded trajectories: how they are collected, kept on disk, split, checked and loaded."""
