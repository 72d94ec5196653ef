"""Derivatives of paths with respect to the numbers of a scene, exact through stick and slip."""
