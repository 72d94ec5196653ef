"""The records of a body: at rest, and the memory in which ramps are followed."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from ...arrays import frozen
from ...body.body import Body
from ...body.couplings import add_friction
from ...body.curves import add_start, list_sliders
from ...body.ground import Track
from ...errors import SceneError
from ...rounding import CRITICAL, EPS
from ..pieces import NO_PIECES
from .records import (
    BACKWARD,
    BLOCK,
    BREAK,
    CLUSTER,
    CONTACT,
    COUPLING,
    COUPLING_PIECE,
    DRAWN,
    END,
    FOOT,
    FORWARD,
    SPRING,
    zeros,
)
from .springs.records import BEND, PIECE, SLIDER, STRAY
from .tournament import find_winners

LONG = 256
"""Contacts of a body that may have sleeping clusters of contacts (`clusters`)."""
LEAF_SIZE = 8
"""Contacts of a leaf of the tree of clusters, and parts of a larger one."""
SHORTEST_BLOCK = 64
"""Contacts of a block from which they fall asleep."""
PROJECTS_AFTER = 2
"""Rounds of the search for the sides of a path after which it goes on from the result of `project`. An implicit step
begins with that: it is far from the velocities before it, while an event changes few of them."""
PATIENCE = 10
"""Rounds, in addition to one for each contact, without fewer violations before contacts are exchanged one by one:
sliding may spread from both ends of a body by one contact a round."""
FEW_CONTACTS = 256
"""Contacts up to which the margin is computed at every event and, on ground, all parts are looked at for critical
states. In larger bodies the margin is computed at the ends of ramps, and only parts in which rates are new are looked
at."""
TOGETHER = 20
"""Knots passed at one place on the ramp before they are passed one after another, by Murty's rule."""
TURNS = 30
"""Solutions of an implicit step with pieces of curves that lead to others, before they are changed one by one."""
_MOST_NUMBERS = 50_000_000
"""Largest number of entries of the matrix of a graph."""


@functools.lru_cache(maxsize=4)
def order_contacts(body: Body) -> tuple[np.ndarray, int]:
    """Order the contacts of a graph so that its stiffness matrix is a narrow band.

    Args:
        body: the body.

    Returns:
        The position of each contact in that order, shape (N,), and the largest distance of two joined contacts.

    Raises:
        SceneError: if the band has too many entries.
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


def _build_clusters(body: Body) -> np.ndarray | None:
    """Build the tree of clusters of a long body, all awake: CLUSTER, leaves first, then level by level, shape (R,).

    Contact i may sleep if it has a spring from contact i - 1, and no other or the next one, to contact i + 1.

    Returns:
        The tree; None if no cluster has contacts that all may sleep.
    """
    joins = np.flatnonzero(body.ends[:, 1] == body.ends[:, 0] + 1)
    before = np.full(body.contacts + 1, -1)
    before[body.ends[joins, 1]] = joins
    springs, here, behind = np.bincount(body.ends.ravel(), minlength=body.contacts), before[:-1], before[1:]
    whole = (here >= 0) & np.where(behind < 0, springs == 1, (springs == 2) & (behind == here + 1))
    levels: list[np.ndarray] = []
    begin, width = 0, 1
    while whole.size > 1:
        parts = whole.size
        whole = np.append(whole, np.zeros(-parts % LEAF_SIZE, bool)).reshape(-1, LEAF_SIZE).all(1)
        level, each, width = np.zeros(whole.size, CLUSTER), np.arange(whole.size), LEAF_SIZE * width
        level["first"], level["last"], level["whole"] = width * each, width * (each + 1) - 1, whole
        level["spring"] = before[level["first"]]
        level["child"] = begin - parts + LEAF_SIZE * each if levels else -1
        begin += whole.size
        level["parent"] = begin + each // LEAF_SIZE if whole.size > 1 else -1
        levels.append(level)
    if not levels[0]["whole"].any():
        return None
    clusters = zeros(begin, CLUSTER)
    clusters[:] = np.concatenate(levels)
    return clusters


def build_memory(body: Body, track: Track | None) -> tuple[Any, ...]:
    """Allocate the memory in which ramps are followed.

    Args:
        body: the body.
        track: the ground. If friction changes with elongations, blocks have dense matrices.

    Returns:
        The fields of a `Model` without ground; only the ends of springs hold data between calls.

    Raises:
        SceneError: if a matrix has too many entries.
    """
    n, count, coupled = body.contacts, body.springs, track is not None and bool(track.couplings)
    at = body.ends.T.ravel()
    order = np.argsort(at, kind="stable")
    ends = zeros(2 * count, END)
    ends["other"] = body.ends.T[::-1].ravel()[order]
    ends["spring"] = np.tile(np.arange(count), 2)[order]
    ends["sign"] = np.repeat([1.0, -1.0], count)[order]
    width = 1 if body.is_chain else max(order_contacts(body)[1], 1)
    if coupled:
        width = n
        if n * n > _MOST_NUMBERS:
            raise SceneError(
                f"friction.with_elongation: {n} contacts need a matrix with {n * n:.1e} entries; at most "
                f"{_MOST_NUMBERS:.0e} are allowed"
            )
    is_simple = body.is_chain and not body.bends and track is None
    matrix = None if is_simple else np.zeros((n, width))
    clusters = _build_clusters(body) if n >= LONG and not body.bends and not coupled else None
    listed, curves = np.zeros(n, np.int32), build_curves(body)
    return ends, zeros(n + 1, BLOCK), listed, matrix, zeros(2 * n, BREAK), NO_PIECES, None, clusters, curves


def build_curves(body: Body) -> tuple[Any, ...] | None:
    """Build the curves of bent springs.

    Args:
        body: the body.

    Returns:
        The fields of `Curves`, with no sliders, which are state; None if all springs are linear.
    """
    if not body.bends:
        return None
    bends, tables = zeros(len(body.bends), BEND), []
    count = 0
    for k, bend in enumerate(body.bends):
        for name, curve in (("actuator", bend.actuator), ("passive", bend.passive)):
            tables.append(curve.pieces)
            bends[name][k] = count
            count += len(tables[-1])
    last = np.cumsum([len(bend.sliders) for bend in body.bends])
    bends["first"][1:], bends["last"] = last[:-1], last
    pieces = zeros(count, PIECE)
    for name, column in zip(("begin", "end", "slope", "at", "value", "energy"), np.concatenate(tables).T, strict=True):
        pieces[name] = column
    return bends, pieces, zeros(body.contacts, STRAY), np.zeros(body.contacts, np.int32), zeros(0, SLIDER)


def build_falls(body: Body, track: Track) -> tuple[np.ndarray, ...]:
    """Allocate the memory in which falls are followed, and find the walls that end them.

    Args:
        body: the body.
        track: the ground.

    Returns:
        The fields `drawn`, `nodes` and `walls` of a `Terrain`.
    """
    walls = frozen(np.empty((2, 0)) if track.walls is None else track.walls.place)
    return zeros(body.contacts, DRAWN), np.zeros(body.contacts + 1, np.int32), walls


def build_couplings(body: Body, track: Track | None) -> tuple[np.ndarray, ...] | None:
    """Build the couplings of a body, memory that holds no data between ramps but what the scene gives.

    Args:
        body: the body.
        track: the ground.

    Returns:
        The fields of `Couplings` without feet, which are state; None without any.
    """
    if track is None or not track.couplings:
        return None
    each, tables = zeros(len(track.couplings), COUPLING), [coupling.pieces for coupling in track.couplings]
    pieces = zeros(sum(map(len, tables)), COUPLING_PIECE)
    for name, column in zip(pieces.dtype.names or (), np.concatenate(tables).T, strict=True):
        pieces[name] = column
    last = np.cumsum([len(table) for table in tables])
    each["first"][1:], each["last"], each["piece"] = last[:-1], last - 1, last - 1
    each["next"] = np.inf
    each["contact"] = [coupling.contact for coupling in track.couplings]
    each["spring"] = [coupling.spring for coupling in track.couplings]
    each["a"], each["b"] = body.ends[each["spring"]].T
    steep = np.zeros((body.contacts, body.springs))
    np.add.at(steep, (each["contact"], each["spring"]), [np.abs(table[:, 4::2]).max() for table in tables])
    steep[body.ends, np.arange(body.springs)[:, None]] -= (1.0 - CRITICAL) * body.stiffness[:, None]
    return each, pieces, np.zeros(body.contacts, np.int64), np.array([steep.max() <= 0.0])


def build_sliders(body: Body, elongation: np.ndarray) -> np.ndarray:
    """Build the sliders of springs with hysteresis, with the forces that they have at the start of the scene.

    Args:
        body: the body.
        elongation: z, shape (..., S) [m].

    Returns:
        SLIDER, shape (..., H).
    """
    spring, stiffness, limit, force = list_sliders(body.bends).T
    sliders = zeros((*elongation.shape[:-1], spring.size), SLIDER)
    sliders["spring"] = spring
    sliders["stiffness"], sliders["limit"], sliders["reach"] = stiffness, limit, limit / stiffness
    sliders["slip"] = elongation[..., spring.astype(np.int64)] - force / stiffness
    sliders["mode"] = np.where(np.abs(force) >= limit, np.sign(force), 0.0)
    return sliders


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
    springs["tension"] = add_start(body.bends, body.tension(springs["elongation"], lengths))
    springs["bend"] = -1
    for k, bend in enumerate(body.bends):
        springs["bend"][..., bend.spring] = k
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
    contacts["winner"] = find_winners(n)
    contacts["order"] = np.arange(n) if body.is_chain else order_contacts(body)[0]
    force = contacts["force"] = body.spring_force(tension)
    friction = forward + backward
    near = 32.0 * EPS * (body.force_size(tension) + np.abs(forward) + np.abs(backward))
    above, below = forward - force, force + backward
    at_forward = (friction == 0.0) | ((above <= near) & (above <= below))
    at_backward = (friction == 0.0) | ((below <= near) & (below < above))
    contacts["bounds_met"] = FORWARD * at_forward + BACKWARD * at_backward
    return contacts


def build_feet(body: Body, track: Track, x: np.ndarray, place: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Build the feet of a body on patches of ground, and between walls.

    Args:
        body: the body.
        track: the ground.
        x: displacement, shape (N,) [m].
        place: of each contact, as in `Track`, shape (N,).
        bounds: as commanded, for ground without patches: forward bounds, backward bounds and, with loads, these, shape
            (2 N,) or (3 N,) [N].

    Returns:
        FOOT, shape (N,).
    """
    n = body.contacts
    feet = zeros(n, FOOT)
    feet["home"], feet["place"] = body.position, place
    feet["weight"], feet["follows"] = track.weight, track.follows
    if track.walls is not None:
        ahead, behind = track.walls.find_rooms(body.position, x) == 0.0
        feet["walled"] = FORWARD * ahead + BACKWARD * behind
    feet["forward"], feet["backward"] = bounds[:n], bounds[n : 2 * n]
    feet["more_forward"], feet["more_backward"] = add_friction(track.couplings, x)
    if bounds.size > 2 * n:
        feet["load"] = bounds[2 * n :]
    return feet
