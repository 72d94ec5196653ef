"""Build a body from isolated contacts, segments and links, and check them against each other."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import frozen, spread
from ..errors import SceneError
from .body import Body
from .segment import Segment


@dataclass(frozen=True, eq=False)
class Interval:
    """A segment, or an isolated contact, before it is built into a body.

    Attributes:
        name: name in the scene, or number of the contact.
        nodes: reference positions of its contacts, increasing, shape (elements + 1,), in the plane (1, 2) [m].
        stiffness: stiffness of its elements, shape (elements,) [N/m].
        shown: number of contacts that are listed; None for all.
    """

    name: int | str
    nodes: np.ndarray
    stiffness: np.ndarray
    shown: int | None = None

    @property
    def cells(self) -> np.ndarray:
        """Length that each contact represents: half of each adjacent element; 1 if isolated, (elements + 1,) [m]."""
        cells = np.ones(len(self.nodes))
        if cells.size > 1:
            cells[:] = float(self.nodes[-1] - self.nodes[0]) / (cells.size - 1)
            cells[[0, -1]] *= 0.5
        return cells


_MOST_SPAN = 1e13
"""Largest ratio of two stiffnesses of a body."""
_NEAR = 1e-12
"""Parts whose ends are closer than this part of their positions touch."""


def touch(until: float, after: float) -> bool:
    """Determine whether a part that ends at one place touches one that begins at another.

    Args:
        until: reference position of the end [m].
        after: reference position of the beginning [m].

    Returns:
        Whether both are the same but for rounding.
    """
    return abs(after - until) <= _NEAR * (abs(until) + abs(after))


def build_body(
    contacts: ArrayLike,
    stiffness: ArrayLike,
    between: Sequence[tuple[int | str, int | str]] | None,
    segments: Sequence[Interval],
) -> Body:
    """Build a body from its contacts, links and segments.

    Parts that touch share a contact: two segments that follow each other, or an isolated contact at an end of one.

    Args:
        contacts: reference positions of the isolated contacts, increasing, shape (I,), or (I, 2) in the plane [m].
        stiffness: stiffness of the links, one number or one per link, > 0 [N/m].
        between: the pair of ends that each link joins: contacts by number, ends of segments as `name.from` and
            `name.to`; None links each part to the next one that it does not touch.
        segments: the segments.

    Returns:
        The body, its arrays read-only.

    Raises:
        SceneError: if a contact, segment or link is invalid; the message names it.
    """
    isolated = np.array(contacts, dtype=np.float64)
    _check_contacts(isolated, segments)
    parts = _in_order(isolated, segments)
    first = _first_contacts(parts)
    place = {part.name: i for part, i in zip(parts, first, strict=True)}
    count = first[-1] + len(parts[-1].nodes)
    position = np.zeros((count, *isolated.shape[1:]))
    share, ground = np.zeros((2, count))
    for part, begin in reversed(list(zip(parts, first, strict=True))):
        at, cells = slice(begin, begin + len(part.nodes)), part.cells
        position[at] = part.nodes
        share[at] += cells / (cells.sum() * len(parts))
        ground[at] += cells
    ends = _link_ends(between, parts, place)
    k = spread(stiffness, len(ends), "body.links.stiffness", "link")
    for i in np.flatnonzero(~(k > 0.0)):
        raise SceneError(f"body.links.stiffness: link {i} has {k[i]:g} N/m; it must be > 0")
    links = len(ends)
    for segment in segments:
        a = place[segment.name] + np.arange(segment.stiffness.size)
        ends += list(zip(a.tolist(), (a + 1).tolist(), strict=True))
        k = np.concatenate((k, segment.stiffness))
    pairs = np.array(ends, dtype=np.int64).reshape(-1, 2)
    if isolated.ndim == 1:
        pairs.sort(axis=1)
    # a link that starts at a segment's near end sorts before the segment's springs, which stay consecutive
    order = np.lexsort((-pairs[:, 1], pairs[:, 0])) if segments else np.arange(len(pairs))
    found = np.argsort(order)
    springs = found[links:]
    built = []
    for segment in segments:
        elements = segment.stiffness.size
        length = float(segment.nodes[-1] - segment.nodes[0])
        name = str(segment.name)
        built.append(Segment(name, place[name], elements, int(springs[0]), length, segment.shown))
        springs = springs[elements:]
    body = Body(
        position=frozen(position),
        ends=frozen(pairs[order], np.int64),
        stiffness=frozen(k[order]),
        share=frozen(share),
        ground=frozen(ground),
        isolated=frozen([place[i] for i in range(isolated.shape[0])], np.int64),
        link_springs=frozen(found[:links], np.int64),
        segments=tuple(built),
    )
    check_connected(body, [part.name for part in parts], first)
    return body


def check_span(body: Body) -> None:
    """Check that the stiffnesses of a body on a line are not too different, with all slopes of its curves.

    Args:
        body: the body.

    Raises:
        SceneError: if they are.
    """
    curves = [curve for bend in body.bends for curve in (bend.actuator, bend.passive)]
    slopes = np.concatenate([body.stiffness, *(curve.slopes for curve in curves)])
    rising = slopes[slopes > 0.0]
    if body.dimension == 1 and rising.size and rising.max() > _MOST_SPAN * rising.min():
        what = "body.links: slopes of" if body.bends else "body.links.stiffness:"
        raise SceneError(
            f"{what} {rising.min():g} to {rising.max():g} N/m; the largest may be at most {_MOST_SPAN:.0e} times the "
            "smallest, or rounding would decide how the softest moves"
        )


def _check_contacts(isolated: np.ndarray, segments: Sequence[Interval]) -> None:
    count = isolated.shape[0]
    if count < 2 and not segments:
        raise SceneError(f"body.contacts: {count} contact(s); a crawler needs at least 2, or a segment")
    if isolated.ndim == 2:
        _, first, where = np.unique(isolated, axis=0, return_index=True, return_inverse=True)
        for i in np.flatnonzero(first[where.ravel()] != np.arange(count)):
            raise SceneError(
                f"body.contacts: contacts {first[where.ravel()[i]]} and {i} are both at {_point(isolated[i])} m"
            )
        return
    for k in np.flatnonzero(np.diff(isolated) <= 0.0):
        raise SceneError(
            f"body.contacts: contact {k + 1} at {isolated[k + 1]:g} m does not lie beyond contact {k} at "
            f"{isolated[k]:g} m; positions must be strictly increasing"
        )


def _point(position: np.ndarray) -> str:
    return "[" + ", ".join(f"{v:g}" for v in position) + "]"


def _first_contacts(parts: list[Interval]) -> list[int]:
    """Find the first contact of each part, which is the last contact of the part before where they touch."""
    first = [0]
    for here, there in itertools.pairwise(parts):
        touches = here.nodes.ndim == 1 and touch(float(here.nodes[-1]), float(there.nodes[0]))
        first.append(first[-1] + len(here.nodes) - touches)
    return first


def _in_order(isolated: np.ndarray, segments: Sequence[Interval]) -> list[Interval]:
    """Sort contacts and segments along the body; they must not overlap."""
    contacts = [Interval(i, isolated[i : i + 1], np.zeros(0)) for i in range(isolated.shape[0])]
    if isolated.ndim == 2 or not segments:
        return contacts
    parts = sorted((*contacts, *segments), key=lambda part: (float(part.nodes[0]), float(part.nodes[-1])))
    for here, there in itertools.pairwise(parts):
        until, after = here.nodes[-1], there.nodes[0]
        if after < until and not touch(float(until), float(after)):
            where = f"at {after:g} m" if isinstance(there.name, int) else f"from {after:g} m"
            raise SceneError(
                f"body: {_name(there.name)} {where} lies inside {_name(here.name)}, which reaches to {until:g} m; "
                "segments must not overlap, and contacts may stand at their ends, but not between them"
            )
    return parts


def _name(part: int | str, noun: str = "contact") -> str:
    return f"{noun} {part}" if isinstance(part, int) else f"segment {part}"


def _link_ends(
    between: Sequence[tuple[int | str, int | str]] | None, parts: list[Interval], place: dict[int | str, int]
) -> list[tuple[int, int]]:
    """Find the two contacts that each link joins."""
    last = {part.name: place[part.name] + len(part.nodes) - 1 for part in parts}
    if between is None:
        pairs = [(last[a.name], place[b.name]) for a, b in itertools.pairwise(parts)]
        return [pair for pair in pairs if pair[0] != pair[1]]
    known: dict[int | str, int] = {}
    for name, first in place.items():
        known |= {name: first} if isinstance(name, int) else {f"{name}.from": first, f"{name}.to": last[name]}
    ends = []
    for i, pair in enumerate(between):
        link = f"body.links.between: link {i} joins"
        for end in pair:
            if isinstance(end, str) and not end.endswith((".from", ".to")):
                raise SceneError(f"{link} {end!r}; an end is a number, `name.from` or `name.to`")
            if end not in known:
                raise SceneError(f"{link} {_end(end)}; {_known(place)}")
        a, b = (known[end] for end in pair)
        if a == b:
            raise SceneError(f"{link} {_end(pair[0])} to itself")
        ends.append((a, b))
    return ends


def _end(end: int | str) -> str:
    return f"contact {end}" if isinstance(end, int) else end


def _known(place: dict[int | str, int]) -> str:
    contacts = sum(isinstance(key, int) for key in place)
    known = [f"contacts 0 .. {contacts - 1}"] if contacts else []
    return "there are " + ", ".join(known + [f"{n}.from, {n}.to" for n in place if isinstance(n, str)])


def check_connected(body: Body, parts: Sequence[int | str], first: Iterable[int], noun: str = "contact") -> None:
    """Check that the springs of a body connect all its parts.

    Args:
        body: the body.
        parts: numbers of its contacts, and names of its segments.
        first: index of the first contact of each.
        noun: what a contact is called.

    Raises:
        SceneError: if they do not; the message names a part that none leads to.
    """
    if body.is_chain:
        return
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    n = body.contacts
    graph = coo_matrix((np.ones(body.springs), (body.ends[:, 0], body.ends[:, 1])), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    for part, i in zip(parts, first, strict=False):
        if label[i] != label[0]:
            raise SceneError(
                f"body.links.between: no links lead from {_name(parts[0], noun)} to {_name(part, noun)}; the body must "
                "be connected"
            )
