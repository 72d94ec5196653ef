"""What a measurement does to a motion: the sensor between positions and values, and its noise.

Functions name their arguments alike; a docstring lists only what it adds to this:

Args:
    time: of the rows, shape (T,) [s].
    values: measured ones, shape (T,) [m].
    residuals: of a fit, in order, shape (T,) [m].
    pixel: step whose multiples the values are, or 0 [m].
    floor: least standard deviation [m].
"""
