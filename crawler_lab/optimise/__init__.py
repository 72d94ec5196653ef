"""The best periodic drive of a crawler within bounds.

Functions name their arguments alike; a docstring lists only what it adds to this:

Args:
    scene: the scene.
    request: what is sought, a `Request`.
    unknowns: the `Unknowns` of the scene.
    values: of the unknowns, shape (P,).
    unit: the same in the unit box, shape (P,).
    space: the candidates, a `Space`.
    cycle: a candidate, a `Cycle`.
    regime: its periodic regime.
    objective: a key of `OBJECTIVES`.
    over: "expected" or "worst": whether the mean or the worst of the drawn bodies counts.
    uncertain: what is known about the numbers of the scene.
    stop: called between batches; True ends the search.
"""
