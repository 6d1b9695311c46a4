"""The table of methods, paired trials, statistics."""
