"""What a fit decides: verdicts, intervals, bounds, and what a misfit means.

Functions name their arguments alike; a docstring lists only what it adds to this:

Args:
    problem: the `Problem`.
    fit: its end, a `Fit`.
    covariance: of the unknowns, shape (U, U).
    structure: from `find_structure`.
    freedom: degrees of freedom of the noise [1].
"""
