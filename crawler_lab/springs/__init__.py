"""From a measured loop of force over elongation to a spring that remembers.

    F = phi(z) + sum_j h_j,  h_j = f_j s_j / r_j,  |s_j| <= r_j

Here phi is a line or a curve of few straight pieces, and s_j follows the elongation z as a stop: it stretches with z,
and rests where an element yields, theory.md 18. An element has the stiffness f_j / r_j.

Functions name their arguments alike; a docstring lists only what it adds to this:

Args:
    path: the elongations, R rows.
    shape: the numbers of pieces and of elements.
    x: parameters, in the order of `Shape`.
"""
