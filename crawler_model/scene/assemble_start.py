"""Assemble the start displacements of a scene, and check that friction admits them."""

from __future__ import annotations

import numpy as np

from ..arrays import spread
from ..body.body import Body
from ..body.drive import Drive
from ..errors import SceneError
from ..rounding import EPS
from ..theory.stasis import bound_distances
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
        Displacement, shape (N,), in the plane (N, 2) [m]. A scene specifies it for the isolated contacts and both ends
        of each segment, with linear interpolation between; `relaxed` is a start without spring forces.

    Raises:
        SceneError: if the number of values is wrong.
    """
    if parts.start is None:
        return np.zeros(body.position.shape)
    if parts.start == "relaxed":
        return body.relaxed(drive.actuation[0])
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
    x = np.empty(body.contacts)
    x[stations] = values
    for k, segment in enumerate(body.segments):
        first, last = values[body.isolated.size + 2 * k :][:2]
        x[segment.contacts] = np.linspace(first, last, segment.elements + 1)
    return x


def check_start(assembly: Assembly) -> None:
    """Check that the spring forces at the start are within the friction at the start.

    Args:
        assembly: the assembly.

    Raises:
        SceneError: if a force exceeds its bound; the message names the contact and the excess.
    """
    body, drive, x = assembly.body, assembly.drive, assembly.start_displacement
    if body.dimension == 2:
        _check_planar_start(assembly)
        return
    tension = body.stiffness * (body.elongation(x) - drive.actuation[0])
    force = body.spring_force(tension)
    forward, backward = _bounds_at_start(assembly)
    margins = bound_distances(force, forward, backward)
    excess = margins + _ROUNDING * (body.force_size(tension) + forward + backward)
    worst = int(np.argmin(excess))
    if excess[worst] >= 0.0:
        return
    if forward[worst] + backward[worst] < 0.0:
        raise SceneError(
            f"start.displacement: {body.name_of(worst)} stands on the border at {body.position[worst] + x[worst]:g} m "
            "between two slopes, a top on which friction holds it against neither; start beside it"
        )
    g = force[worst]
    bound, side = (forward[worst], "forward") if g > 0.0 else (backward[worst], "backward")
    proposal = "write `start: relaxed`"
    if not body.segments:
        relaxed = x[0] + body.relaxed(drive.actuation[0])
        text = ", ".join(f"{v:.6g}" for v in relaxed[:12]) + (", ..." if relaxed.size > 12 else "")
        proposal = f"a start without tension is [{text}], or {proposal}"
    raise SceneError(
        f"start.displacement: {body.name_of(worst)} is pulled by {abs(g):g} N, {-margins[worst]:g} N more than its "
        f"{side} friction {bound:g} N; {proposal}"
    )


def _bounds_at_start(assembly: Assembly) -> tuple[np.ndarray, np.ndarray]:
    """Compute the forward and backward bounds at the start, those of the patches where there are any."""
    body, drive, track = assembly.body, assembly.drive, assembly.ground.track
    if track is None:
        return drive.forward[0], drive.backward[0]
    place = track.find_places(body.position, assembly.start_displacement)
    forward, backward, _ = track.bounds(drive.targets[0, body.springs :], place)
    return forward, backward


def _check_planar_start(assembly: Assembly) -> None:
    body, drive, x = assembly.body, assembly.drive, assembly.start_displacement
    tension = body.stiffness[:, None] * (body.elongation(x) - drive.actuation[0].reshape(-1, 2))
    force = body.spring_force(tension)
    friction = drive.targets[0, 2 * body.springs :].reshape(body.contacts, -1)
    normals = assembly.directions
    load = np.linalg.norm(force, axis=1)[:, None] if normals.size == 0 else force @ normals.T
    excess = (load - friction).max(axis=1) - _ROUNDING * (np.abs(tension).sum() + friction.max(axis=1))
    worst = int(np.argmax(excess))
    if excess[worst] > 0.0:
        raise SceneError(
            f"start.displacement: contact {worst} is pulled by [{force[worst, 0]:g}, {force[worst, 1]:g}] N, "
            f"{excess[worst]:g} N more than its friction; `start: relaxed` is a start without tension"
        )
