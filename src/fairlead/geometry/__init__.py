"""Shapes, fields, frames, distances, goals and random motions, in numpy alone."""
