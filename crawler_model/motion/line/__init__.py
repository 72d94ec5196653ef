"""Bodies on a line: one event-driven engine for chains and graphs, on any ground.

Kernels name their arguments alike. Records are described in `records`; a docstring lists only what it adds to this:

Args:
    contacts: CONTACT, shape (N,).
    springs: SPRING, shape (S,).
    model: a `Model`.
    matrix: its matrix; None where all blocks are paths.
    ramp: the RAMP.
    ends: END, shape (2 S,).
    block: BLOCK, memory for the present block.
    listed: the contacts around which rates change.
    clusters: CLUSTER; None for bodies without long paths.
    curves: a `Curves`; None if all springs are linear.
    pieces: PIECE, of all curves.
    ground: a `Terrain`; None on ground that is the same everywhere.
    couplings: the `Couplings`; None if no friction changes with elongations.
    s: place on the ramp, or on the fall that the contact or the spring takes part in.
    n: number of contacts N.
    c: the CONTACT.
    i: its index.
    foot: its FOOT.
    spring: the SPRING.
    bend: its BEND.
    sliders: SLIDER, shape (H,).
    z: its elongation [m].
    u: z - L [m].
    count: number of contacts of the block, or of its rows where a sleeping cluster is one.
    coming: the border, AHEAD or BEHIND.
"""
