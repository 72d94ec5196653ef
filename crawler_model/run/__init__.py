"""Runs of a drive from start to end, and their energy account."""
