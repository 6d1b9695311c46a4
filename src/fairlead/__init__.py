"""Fairlead plans with a learned model of a rope and knows where that model can be trusted."""

__version__ = "0.1.0"
