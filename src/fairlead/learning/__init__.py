"""Dynamics, trust, recovery, and the one loop that trains them. The only package that imports torch."""
