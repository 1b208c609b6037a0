"""The figures, one in each file."""
