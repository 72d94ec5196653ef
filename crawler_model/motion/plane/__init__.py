"""Bodies in the plane, solved to a tolerance.

Kernels name their arguments alike; a docstring lists only what it adds to this:

Args:
    frame: a `Frame`, the body.
    command: the commands in force, as in a target, shape (C,).
    target: commands at the end of the ramp, shape (C,).
    x: displacements, shape (N, 2) [m].
    base: displacements at the start of the step, shape (N, 2) [m].
    moved: last displacements of the points, shape (N, 2) [m].
    i: the point.
    at: where its friction begins in a command.
    k: the spring: a link, a component of a vector spring, or a joint.
    c: 0 for x, 1 for y.
    account: entries as in `motion.account`, added to, shape (15,).
"""
