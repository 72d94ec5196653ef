"""Ramps in the plane in parts of the body that do not feel each other."""
