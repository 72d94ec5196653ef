"""Assemble contacts and springs from the body of a scene."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from ..arrays import frozen, join, refuse, spread
from ..body.body import Body
from ..body.build_body import Interval, build_body, check_span
from ..body.columns import Columns
from ..body.directions import unit_directions
from ..body.ground import Ground
from ..body.turning import SIDES
from ..errors import SceneError
from .assemble_links import assemble_bends, read_links
from .assemble_turning import assemble_turning_body
from .friction_parts import TablePart
from .link_parts import SegmentPart
from .parts import SceneParts


def _interval(part: SegmentPart, place: int, elements: int) -> Interval:
    field = f"body.segments.{place}"
    if part.stiffness is not None:
        _check_sign(part.stiffness, f"{field}.stiffness", "N", "> 0")
    sides = tuple(zip(("forward", "backward"), part.friction.sides, strict=True))
    for side, value in sides:
        _check_sign(value, f"{field}.friction.{side}", "N/m", ">= 0")
    for name, value in (("stiffness", part.stiffness), *sides):
        if isinstance(value, TablePart) and not (value.at[0] <= part.stop and value.at[-1] >= part.start):
            raise SceneError(
                f"{field}: the table of {name} covers {value.at[0]:g} .. {value.at[-1]:g} m, outside the "
                f"segment's {part.start:g} .. {part.stop:g} m"
            )
    nodes = np.linspace(part.start, part.stop, elements + 1)
    return Interval(part.name, nodes, _element_stiffness(part, nodes), part.shown)


def _check_sign(part: float | TablePart, field: str, unit: str, least: str) -> None:
    """Check that a quantity along a segment is as `least` says, "> 0" or ">= 0"."""
    for value in part.value if isinstance(part, TablePart) else (part,):
        if value < 0.0 or (value == 0.0 and least == "> 0"):
            raise SceneError(f"{field}: {value:g} {unit}; it must be {least}")


def _element_stiffness(part: SegmentPart, nodes: np.ndarray) -> np.ndarray:
    """Compute the stiffness of a segment's elements, (..., elements) [N/m]; 1 if it has another curve of tension."""
    elements = nodes.size - 1
    if part.stiffness is None:
        return np.ones(elements)
    if isinstance(part.stiffness, TablePart):
        compliance = _average_compliance(part.stiffness, nodes)
    else:
        compliance = np.repeat(np.atleast_1d(1.0 / part.stiffness), elements, axis=-1)
    return np.asarray(1.0 / (compliance * (part.stop - part.start) / elements))


def _average_compliance(modulus: TablePart, nodes: np.ndarray) -> np.ndarray:
    """Compute the mean of 1 / k over each element: k is linear between cuts, and the integral of 1 / k a logarithm."""
    at = np.array(modulus.at)
    cuts = np.union1d(nodes, at[(at > nodes[0]) & (at < nodes[-1])])
    k = np.interp(cuts, at, modulus.value)
    growth = np.diff(k) / k[:-1]
    mean = np.divide(np.log1p(growth), growth, out=np.ones_like(growth), where=growth != 0.0) / k[:-1]
    integral = np.concatenate(([0.0], np.cumsum(mean * np.diff(cuts))))
    return np.diff(integral[np.searchsorted(cuts, nodes)]) / np.diff(nodes)


def assemble_body(parts: SceneParts, elements: Sequence[int]) -> Body:
    """Build the body of a scene.

    Args:
        parts: the parts of the scene.
        elements: number of elements of each segment.

    Returns:
        The body.

    Raises:
        SceneError: if a contact, segment or link is invalid; the message names it.
    """
    given = parts.body
    if given.springs == "length":
        return assemble_turning_body(parts)
    for i, contact in enumerate(given.contacts):
        if isinstance(contact, tuple) and parts.dimension == 1:
            raise SceneError(
                f"body.contacts: contact {i} is {list(contact)}; on a line it is a number (or dimension: 2)"
            )
    segments = [_interval(s, i, n) for i, (s, n) in enumerate(zip(given.segments, elements, strict=True))]
    between, stiffness = read_links(given)
    contacts = np.array(given.contacts, dtype=np.float64)
    if parts.dimension == 2:
        contacts = contacts.reshape(-1, 2)
    body = assemble_bends(parts, build_body(contacts, stiffness, between, segments))
    check_span(body)
    return body


def reuse_body(parts: SceneParts, like: Body, doubts: np.ndarray | None = None) -> Body:
    """Build the body of a scene from another one with the same mesh, which differs at most in its stiffness.

    Args:
        parts: the parts of the scene.
        like: the other body.
        doubts: of variations, as for `refuse`.

    Returns:
        The body; the other one itself if its stiffness is the same.

    Raises:
        SceneError: if a stiffness is not positive.
    """
    segments = zip(parts.body.segments, like.segments, strict=True)
    for place, part in enumerate(parts.body.segments):
        if part.stiffness is not None and not isinstance(part.stiffness, np.ndarray):
            _check_sign(part.stiffness, f"body.segments.{place}.stiffness", "N", "> 0")
    given = spread(read_links(parts.body)[1], like.link_springs.size, "body.links.stiffness", "link")
    together = join((given, *(_element_stiffness(part, like.position[s.contacts]) for part, s in segments)))
    stiffness = np.empty(together.shape)
    first = like.link_springs.size
    stiffness[..., like.link_springs] = together[..., :first]
    for segment in like.segments:
        stiffness[..., segment.springs] = together[..., first : first + segment.elements]
        first += segment.elements
    refuse(~(stiffness > 0.0), 1, lambda i: f"body: spring {i} has {stiffness[i]:g} N/m; it must be > 0", doubts)
    if parts.body.is_bent:
        bent = assemble_bends(parts, dataclasses.replace(like, stiffness=stiffness, bends=()))
        check_span(bent)
        return bent
    return like if np.array_equal(stiffness, like.stiffness) else dataclasses.replace(like, stiffness=frozen(stiffness))


def assemble_columns(parts: SceneParts, body: Body, ground: Ground, like: Columns | None = None) -> Columns:
    """Build the command layout of the body of a scene.

    Args:
        parts: the parts of the scene.
        body: its body.
        ground: its ground.
        like: the layout of another scene, which differs at most in its loads; None to build all of it.

    Returns:
        The columns, `like` itself if the slope adds the same loads. A segment has one column for its strain unless a
        wave runs along it, and one per side for its friction unless that varies along it.
    """
    slope_load, patched = _loads_of_slope(parts, ground), ground.track is not None
    same = None if like is None else like.slope_load
    if like is not None and parts.dimension == 1 and (slope_load is None) == (same is None):
        if patched == like.patched and (slope_load is None or same is None or np.array_equal(slope_load, same)):
            return like
        return dataclasses.replace(like, slope_load=slope_load, patched=patched)
    if parts.dimension == 2:
        return _planar_columns(body, unit_directions(parts.angles), slope_load)
    return _line_columns(parts, body, slope_load, patched)


def _line_columns(parts: SceneParts, body: Body, slope_load: np.ndarray | None, patched: bool) -> Columns:
    """Build the command layout of a body on a line."""
    strain = parts.drive is not None and parts.drive.wave is not None
    wave = parts.drive is not None and parts.drive.friction_wave is not None
    varies = [wave or any(isinstance(value, TablePart) for value in s.friction.sides) for s in parts.body.segments]
    segments = tuple(
        (s.name, s.elements if strain else 1, s.elements + 1 if friction else 1)
        for s, friction in zip(body.segments, varies, strict=True)
    )
    links, contacts = body.link_springs.size, body.isolated.size
    sides = 2 if slope_load is None else 3
    index = np.full(body.springs + sides * body.contacts, -1, dtype=np.int64)
    factor = np.ones(index.size)
    further: list[tuple[int, int, float]] = []

    def enter(entries: np.ndarray, columns: np.ndarray, factors: np.ndarray) -> None:
        for k in np.flatnonzero(index[entries] >= 0):
            further.append((int(entries[k]), int(columns[k]), float(factors[k])))
        free = index[entries] < 0
        index[entries[free]], factor[entries[free]] = columns[free], factors[free]

    index[body.link_springs] = np.arange(links)
    column = links
    for segment, (_, size, _) in zip(body.segments, segments, strict=True):
        index[segment.springs] = column + np.arange(segment.elements) % size
        factor[segment.springs] = segment.element
        column += size
    for first in (body.springs, body.springs + body.contacts):
        index[first + body.isolated] = column + np.arange(contacts)
        column += contacts
        for segment, (_, _, size) in zip(body.segments, segments, strict=True):
            places = np.arange(segment.first, segment.last + 1)
            enter(first + places, column + np.arange(places.size) % size, segment.cells)
            column += size
    if slope_load is not None:
        first = body.springs + 2 * body.contacts
        index[first + body.isolated] = column + np.arange(contacts)
        for k, segment in enumerate(body.segments):
            places = np.arange(segment.first, segment.last + 1)
            enter(first + places, np.full(places.size, column + contacts + k), segment.cells)
    entries, added, factors = zip(*further, strict=True) if further else ((), (), ())
    sums = np.array(entries, np.int64), np.array(added, np.int64), np.array(factors)
    return Columns(links, contacts, segments, None, index, factor, slope_load, patched=patched, further=sums)


def _planar_columns(body: Body, directions: np.ndarray, slope_load: np.ndarray | None) -> Columns:
    """Build the command layout of a body in the plane; a row equals its target but for the load of the slope."""
    turns = body.turning is not None
    sides = len(SIDES) if turns else directions.shape[0]
    size = body.lengths + body.contacts * (max(sides, 1) + (0 if slope_load is None else 2))
    joints = body.lengths - body.springs if turns else None
    index, factor = np.arange(size), np.ones(size)
    return Columns(body.springs, body.contacts, (), sides, index, factor, slope_load, directions, joints=joints)


def _loads_of_slope(parts: SceneParts, ground: Ground) -> np.ndarray | None:
    """Compute what the slope adds to the loads, (..., N) or (N, 2) [N]; None if level and no load is commanded."""
    drive = parts.drive
    loaded = parts.loads is not None or (drive is not None and drive.loads is not None) or np.any(ground.slope != 0.0)
    return ground.slope_load if loaded else None
