"""Kinds of random scenes with truths of their own, for `trust.py`: one file for each family."""
