"""Kinodynamic planning through the roles."""
