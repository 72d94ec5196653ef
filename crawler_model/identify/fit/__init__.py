"""Least squares over the numbers of a scene and of the sensors, from several starts."""
