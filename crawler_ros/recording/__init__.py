"""Recordings: writing them beside a node, and reading them."""
