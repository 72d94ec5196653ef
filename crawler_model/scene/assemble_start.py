"""Assemble the start displacements of a scene, and check that friction admits them."""

from __future__ import annotations

import dataclasses

import numpy as np

from ..arrays import frozen, spread
from ..body.body import Body
from ..body.curves import add_start
from ..body.drive import Drive
from ..body.planar_loads import split_target
from ..errors import SceneError
from ..rounding import EPS
from ..theory.stasis import bound_distances
from .assemble_turning import check_turning_start
from .assembly import Assembly
from .parts import SceneParts

_ROUNDING = 1e3 * 32.0 * EPS


def assemble_start(parts: SceneParts, body: Body, drive: Drive) -> np.ndarray:
    """Compute the displacements at the start.

    Args:
        parts: the parts of the scene.
        body: its body.
        drive: its drive; the first row is in force at the start.

    Returns:
        Displacement, shape (..., N), in the plane (N, 2) [m]. A scene specifies it for the isolated contacts and both
        ends of each segment, with linear interpolation between; `relaxed` is a start without spring forces
        (`relax_loaded` where loads do not allow that).

    Raises:
        SceneError: if the number of values is wrong.
    """
    if parts.start is None:
        return np.zeros(body.position.shape)
    if parts.start == "relaxed":
        return body.relaxed(body.start_lengths(drive.actuation[..., 0, :]))
    given = parts.start.displacement
    if body.dimension == 2:
        rows = given if isinstance(given, tuple) else (given,) * body.contacts
        if len(rows) != body.contacts or any(isinstance(r, tuple) and len(r) != 2 for r in rows):
            raise SceneError(f"start.displacement: in a planar scene it is [x, y] for each of {body.contacts} contacts")
        return np.array([spread(row, 2, "start.displacement", "coordinate") for row in rows])
    if isinstance(given, tuple) and any(isinstance(v, tuple) for v in given):
        raise SceneError("start.displacement: on a line each entry is a number (or dimension: 2)")
    stations = body.stations
    item = "contact(s) and segment end" if body.segments else "contact"
    values = spread(given, stations.size, "start.displacement", item)
    x = np.empty((*values.shape[:-1], body.contacts))
    x[..., stations] = values
    for entry in np.flatnonzero((x[..., stations] != values).any(axis=tuple(range(values.ndim - 1)))):
        contact = int(stations[entry])
        raise SceneError(
            f"start.displacement: entry {entry} is {values[..., entry]:g} m, but another one for the same contact, "
            f"{body.name_of(contact)}, is {x[..., contact]:g} m; parts that touch move together there"
        )
    for k, segment in enumerate(body.segments):
        ends = values[..., body.isolated.size + 2 * k :][..., :2].reshape(-1, 2)
        between = [np.linspace(first, last, segment.elements + 1) for first, last in ends]
        x[..., segment.contacts] = np.array(between).reshape(*values.shape[:-1], -1)
    return x


def relax_loaded(assembly: Assembly) -> Assembly:
    """Replace a start without spring forces by one that the loads allow.

    A contact whose load exceeds its own friction must be held by springs. The tensions then have the least elastic
    energy within the bounds, as the body ends if it is put down without tension and the loads are applied in one
    catch-up step. On patches the ground where contacts are without tension determines the bounds.

    Args:
        assembly: the assembly of a scene with `start: relaxed`.

    Returns:
        The assembly with that start, or itself if no contact needs springs, or in the plane. For variations, those that
        need it get another start.
    """
    body = assembly.body
    if assembly.parts.start != "relaxed" or body.dimension == 2:
        return assembly
    if body.bends and not body.is_chain:
        grip = np.ones(2 * body.contacts)  # without a change there would be no step
        x = _step_to(assembly, grip, np.zeros_like(grip))
        assembly = dataclasses.replace(assembly, start_displacement=frozen(x - x[0]))
    forward, backward, load = _bounds_at_start(assembly)
    held = ((forward < 0.0) | (backward < 0.0)).any(axis=-1) & (forward + backward >= 0.0).all(axis=-1)
    if not held.any():
        return assembly
    if held.ndim:
        start = np.broadcast_to(assembly.start_displacement, (held.size, assembly.body.contacts)).copy()
        for at in np.flatnonzero(held):
            start[at] = relax_loaded(assembly.variation(int(at))).start_displacement
        return dataclasses.replace(assembly, start_displacement=frozen(start))
    x = _step_to(assembly, np.concatenate((forward + load, backward - load)), np.concatenate((forward, backward)))
    return dataclasses.replace(assembly, start_displacement=frozen(x))


def _step_to(assembly: Assembly, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Compute where a body ends if its bounds change in one catch-up step, shape (N,) [m].

    Patches have no effect, and elements of hysteresis exert no force, as at the start.
    """
    from ..crawler.crawler import Crawler  # most scenes are loaded without kernels

    bends = tuple(dataclasses.replace(bend, sliders=()) for bend in assembly.body.bends)
    even = dataclasses.replace(
        assembly,
        body=dataclasses.replace(assembly.body, bends=bends),
        ground=dataclasses.replace(assembly.ground, track=None),
    )
    commands = [np.concatenate((assembly.drive.actuation[0], bounds)) for bounds in (before, after)]
    crawler = Crawler(even, "catch_up").placed(assembly.start_displacement, commands[0])
    crawler.follow(commands[1][None])
    return crawler.displacement


def check_start(assembly: Assembly) -> None:
    """Check that the spring forces at the start are within the friction at the start.

    Args:
        assembly: the assembly.

    Raises:
        SceneError: if a force exceeds its bound; the message names the contact and the excess.
    """
    body, drive, x = assembly.body, assembly.drive, assembly.start_displacement
    if body.turning is not None:
        check_turning_start(assembly)
        return
    if body.dimension == 2:
        _check_planar_start(assembly)
        return
    _check_walls(assembly)
    force, margins, excess = _forces_at_start(assembly)
    forward, backward, load = _bounds_at_start(assembly)
    worst = int(np.argmin(excess))
    if excess[worst] >= 0.0:
        return
    if forward[worst] + backward[worst] < 0.0:
        raise SceneError(
            f"start.displacement: {body.name_of(worst)} stands on the border at {body.position[worst] + x[worst]:g} m "
            "between two slopes, a top on which friction holds it against neither; start next to it"
        )
    g = force[worst]
    ahead = forward[worst] - g < g + backward[worst]
    bound, side = (forward[worst], "forward") if ahead else (backward[worst], "backward")
    elsewhere = "the least tensions that hold the loads meet other bounds there: write `start.displacement`"
    if load[worst] != 0.0:
        proposal = "write `start: relaxed` for the least tensions that hold the loads"
        if assembly.parts.start == "relaxed":
            proposal = elsewhere
        raise SceneError(
            f"start.displacement: {body.name_of(worst)} is pulled by {abs(g):g} N, {-margins[worst]:g} N more than the "
            f"{bound:g} N that its load of {load[worst]:g} N leaves of its {side} friction; {proposal}"
        )
    proposal = "write `start: relaxed`"
    if any(bend.limits[0] > 0.0 or bend.limits[1] < 0.0 for bend in body.bends):
        proposal = "where limits of `tension` leave 0 N out, actuators pull at any start: widen them, or raise friction"
    elif assembly.parts.start == "relaxed":
        proposal = elsewhere
    elif not body.segments:
        free = x[0] + body.relaxed(body.start_lengths(drive.actuation[0]))
        text = ", ".join(f"{v:.6g}" for v in free[:12]) + (", ..." if free.size > 12 else "")
        proposal = f"a start without tension is [{text}], or {proposal}"
    raise SceneError(
        f"start.displacement: {body.name_of(worst)} is pulled by {abs(g):g} N, {-margins[worst]:g} N more than its "
        f"{side} friction {bound:g} N; {proposal}"
    )


def _check_walls(assembly: Assembly) -> None:
    """Check that no contact starts beyond a wall."""
    body, track = assembly.body, assembly.ground.track
    if track is None or track.walls is None:
        return
    rooms = track.walls.find_rooms(body.position, assembly.start_displacement)
    side, i = np.unravel_index(int(rooms.argmin()), rooms.shape)
    if rooms[side, i] < 0.0:
        raise SceneError(
            f"ground.walls: wall {track.walls.index[side, i]} stops {('forward', 'backward')[side]} at "
            f"{track.walls.place[side, i]:g} m, but {body.name_of(int(i))} starts {-rooms[side, i]:g} m beyond it, at "
            f"{body.position[i] + assembly.start_displacement[i]:g} m"
        )


def starts_beyond(assembly: Assembly) -> np.ndarray:
    """Find the variations of a body on a line whose spring forces at the start are not within the friction.

    Args:
        assembly: the assembly, with a leading axis of variations in what varies.

    Returns:
        Whether a force exceeds its bound, shape (...).
    """
    return np.asarray((_forces_at_start(assembly)[2] < 0.0).any(axis=-1))


def _forces_at_start(assembly: Assembly) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute the spring forces at the start, their distances from the bounds, and these less rounding, (..., N)."""
    body, track, x = assembly.body, assembly.ground.track, assembly.start_displacement
    lengths = body.start_lengths(assembly.drive.actuation[..., 0, :])
    tension = add_start(body.bends, body.tension(body.elongation(x), lengths))
    force = body.spring_force(tension)
    forward, backward, _ = _bounds_at_start(assembly)
    margins = bound_distances(force, forward, backward)
    if track is not None and track.walls is not None:  # a wall holds any force
        ahead, behind = track.walls.find_rooms(body.position, x) == 0.0
        margins = np.minimum(np.where(ahead, np.inf, forward - force), np.where(behind, np.inf, force + backward))
    ends = np.abs(x)[..., body.ends]
    terms = body.stiffness * (ends.sum(axis=-1) + np.abs(lengths))  # terms of T
    return force, margins, margins + _ROUNDING * (body.force_size(terms) + forward + backward)


def _bounds_at_start(assembly: Assembly) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute forward bounds, backward bounds and loads at the start, on patches as they are there, shape (..., N)."""
    body, drive, track = assembly.body, assembly.drive, assembly.ground.track
    if track is not None:
        return track.local_bounds(drive.targets[0, body.springs :], body.position, assembly.start_displacement)
    forward, backward = drive.forward[..., 0, :], drive.backward[..., 0, :]
    return forward, backward, drive.loads[..., 0, :] if assembly.columns.loads else np.zeros_like(forward)


def _check_planar_start(assembly: Assembly) -> None:
    body, drive, x = assembly.body, assembly.drive, assembly.start_displacement
    tension = body.stiffness[:, None] * (body.elongation(x) - drive.actuation[0].reshape(-1, 2))
    _, friction, loads = split_target(body, assembly.directions, drive.targets[0])
    friction = assembly.ground.scale_friction(friction, body.position + x)
    force = body.spring_force(tension)
    if loads.size:
        force = force + loads
    near = _ROUNDING * (np.abs(tension).sum() + np.abs(loads).sum() + friction.max(axis=1))
    excess = _beyond(force, friction, assembly.directions) - near
    worst = int(np.argmax(excess))
    if excess[worst] > 0.0:
        proposal = "`start: relaxed` is a start without tension"
        if loads.size and (_beyond(loads, friction, assembly.directions) > near).any():
            proposal = (
                "a load exceeds the friction of its own contact: start where springs carry some of it to the others"
            )
        raise SceneError(
            f"start.displacement: contact {worst} is pulled by [{force[worst, 0]:g}, {force[worst, 1]:g}] N, "
            f"{excess[worst]:g} N more than its friction; {proposal}"
        )


def _beyond(force: np.ndarray, friction: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Compute how far forces lie outside the sets of friction forces, shape (N,)."""
    size = np.linalg.norm(force, axis=1)[:, None] if normals.size == 0 else force @ normals.T
    return np.asarray((size - friction).max(axis=1))
