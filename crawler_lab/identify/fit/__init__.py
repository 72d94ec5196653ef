"""Least squares over the numbers of a scene and of the sensors, from several starts.

Functions name their arguments alike; a docstring lists only what it adds to this:

Args:
    problem: the `Problem`.
    fit: its end, a `Fit`.
    space: the parameters, a `Space`.
    rng: source of random numbers.
    values: of the parameters, shape (P,).
    unknowns: parameters, then numbers of the sensors, shape (U,).
    recording: its index.
"""
