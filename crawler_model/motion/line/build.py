"""The records of a body: at rest, and the memory in which ramps are followed."""

from __future__ import annotations

import functools

import numpy as np

from ...body.body import Body
from ...body.ground import Track
from ...errors import SceneError
from ...rounding import EPS
from ..pieces import NO_PIECES
from .records import BACKWARD, BLOCK, CONTACT, END, FOOT, FORWARD, SPRING, zeros

_MOST_NUMBERS = 50_000_000
"""Largest number of entries of the matrix of a graph."""


@functools.lru_cache(maxsize=4)
def _order(body: Body) -> tuple[np.ndarray, int]:
    """Order the contacts of a graph so that its stiffness matrix is a narrow band.

    Returns the position of each contact in that order, shape (N,), and the largest distance of two joined contacts.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    n = body.contacts
    a, b = body.ends.T
    graph = coo_matrix((np.ones(2 * a.size), (np.concatenate((a, b)), np.concatenate((b, a)))), shape=(n, n)).tocsr()
    place = np.argsort(reverse_cuthill_mckee(graph, symmetric_mode=True))
    width = int(np.abs(place[a] - place[b]).max())
    if n * width > _MOST_NUMBERS:
        raise SceneError(
            f"body.links.between: the links of {n} contacts need a band matrix with {n * width:.1e} entries; "
            f"at most {_MOST_NUMBERS:.0e} are allowed"
        )
    return place, width


def build_memory(body: Body) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, None]:
    """Allocate the memory in which ramps are followed.

    Args:
        body: the body.

    Returns:
        The fields of a `Model` without ground; beside the ends of springs they hold no data between calls.
    """
    n, count = body.contacts, body.springs
    at = body.ends.T.ravel()
    order = np.argsort(at, kind="stable")
    ends = zeros(2 * count, END)
    ends["other"] = body.ends.T[::-1].ravel()[order]
    ends["spring"] = np.tile(np.arange(count), 2)[order]
    ends["sign"] = np.repeat([1.0, -1.0], count)[order]
    width = 1 if body.is_chain else max(_order(body)[1], 1)
    return ends, zeros(n + 1, BLOCK), np.zeros((n, width)), NO_PIECES, None


def build_springs(body: Body, x: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Build the springs of a body at rest.

    Args:
        body: the body, or variations of it.
        x: displacement, shape (..., N) [m].
        lengths: L of each spring, shape (..., S) [m].

    Returns:
        SPRING, shape (..., S).
    """
    springs = zeros((*x.shape[:-1], body.springs), SPRING)
    springs["a"], springs["b"] = body.ends.T
    springs["stiffness"], springs["compliance"] = body.stiffness, 1.0 / body.stiffness
    springs["length"] = springs["still_length"] = lengths
    for segment in body.segments:
        springs["element"][..., segment.springs] = 1
    springs["elongation"] = body.elongation(x)
    springs["tension"] = body.stiffness * (springs["elongation"] - lengths)
    springs["still_tension"] = springs["tension"]
    return springs


def build_contacts(body: Body, x: np.ndarray, tension: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Build the contacts of a body at rest; one within rounding of a bound is at that bound.

    Args:
        body: the body, or variations of it.
        x: displacement, shape (..., N) [m].
        tension: T of each spring, shape (..., S) [N].
        bounds: forward bounds, backward bounds and, with loads, these, shape (..., 2 N) or (..., 3 N) [N].

    Returns:
        CONTACT, shape (..., N).
    """
    n = body.contacts
    contacts = zeros(x.shape, CONTACT)
    contacts["x"], contacts["share"] = x, body.share
    forward, backward, load = np.split(bounds, (n, 2 * n), axis=-1)
    contacts["forward"], contacts["backward"] = forward, backward
    if load.size:
        contacts["load"] = load
    at = np.sort(body.ends.ravel())
    contacts["first"] = np.searchsorted(at, np.arange(n))
    contacts["last"] = np.searchsorted(at, np.arange(n), "right")
    contacts["order"] = np.arange(n) if body.is_chain else _order(body)[0]
    force = contacts["force"] = body.spring_force(tension)
    friction = forward + backward
    near = 32.0 * EPS * (body.force_size(tension) + np.abs(forward) + np.abs(backward))
    above, below = forward - force, force + backward
    at_forward = (friction == 0.0) | ((above <= near) & (above <= below))
    at_backward = (friction == 0.0) | ((below <= near) & (below < above))
    contacts["at"] = FORWARD * at_forward + BACKWARD * at_backward
    return contacts


def build_feet(body: Body, track: Track, place: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Build the feet of a body on patches of ground.

    Args:
        body: the body.
        track: the ground.
        place: of each contact, as in `Track`, shape (N,).
        bounds: as commanded, for ground without patches: forward bounds, backward bounds and, with loads, these, shape
            (2 N,) or (3 N,) [N].

    Returns:
        FOOT, shape (N,).
    """
    n = body.contacts
    feet = zeros(n, FOOT)
    feet["home"], feet["place"] = body.position, place
    feet["weight"], feet["follows"] = track.stretches.weight, track.stretches.follows
    feet["forward"], feet["backward"] = bounds[:n], bounds[n : 2 * n]
    if bounds.size > 2 * n:
        feet["load"] = bounds[2 * n :]
    return feet
