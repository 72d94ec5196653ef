"""Scenes: from a file to parts, checks and assembled arrays."""
