"""Recordings: writing them next to a node, and reading them."""
