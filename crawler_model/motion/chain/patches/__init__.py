"""Patches of ground: borders that contacts of a chain cross within a ramp, and jumps there."""
