"""From the start of a scene to displacements that its friction admits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import spread
from ..errors import SceneError
from .scene import Scene

if TYPE_CHECKING:
    pass


_ROUNDING = 1e3 * 32.0 * np.finfo(np.float64).eps


def build_start(scene: Scene) -> np.ndarray:
    """Place the contacts at the start.

    Args:
        scene: the scene.

    Returns:
        Displacement, shape (N,), in the plane (N, 2) [m]. A scene gives it for the isolated contacts and both ends of
        each segment, straight between; `relaxed` is a start without spring forces.

    Raises:
        SceneError: on a wrong length.
    """
    mesh = scene.mesh
    if scene.start is None:
        return np.zeros(mesh.position.shape)
    if scene.start == "relaxed":
        return mesh.relaxed(scene.commands.actuation[0])
    given = scene.start.displacement
    if mesh.dimension == 2:
        rows = given if isinstance(given, tuple) else (given,) * mesh.contacts
        if len(rows) != mesh.contacts or any(isinstance(r, tuple) and len(r) != 2 for r in rows):
            raise SceneError(f"start.displacement: a planar scene gives [x, y] for each of {mesh.contacts} contacts")
        return np.array([spread(row, 2, "start.displacement", "coordinate") for row in rows])
    if isinstance(given, tuple) and any(isinstance(v, tuple) for v in given):
        raise SceneError("start.displacement: on a line each entry is a number (or dimension: 2)")
    stations = mesh.stations
    item = "contact(s) and segment end" if mesh.segments else "contact"
    values = spread(given, stations.size, "start.displacement", item)
    x = np.empty(mesh.contacts)
    x[stations] = values
    for k, segment in enumerate(mesh.segments):
        first, last = values[mesh.isolated.size + 2 * k :][:2]
        x[segment.contacts] = np.linspace(first, last, segment.elements + 1)
    return x


def check_start(scene: Scene) -> None:
    """Check that the springs' forces at the start are within the friction at the start.

    Args:
        scene: the scene; its parts are built and so checked on the way.

    Raises:
        SceneError: naming the contact and by how much its bound is exceeded.
    """
    mesh, drive, x = scene.mesh, scene.commands, scene.start_displacement
    if mesh.dimension == 2:
        _check_planar_start(scene)
        return
    tension = mesh.stiffness * (mesh.elongation(x) - drive.actuation[0])
    force, forward, backward = mesh.spring_force(tension), drive.forward[0], drive.backward[0]
    margins = np.minimum(forward - force, force + backward)
    excess = margins + _ROUNDING * (mesh.force_size(tension) + forward + backward)
    worst = int(np.argmin(excess))
    if excess[worst] >= 0.0:
        return
    g = force[worst]
    bound, side = (forward[worst], "forward") if g > 0.0 else (backward[worst], "backward")
    proposal = "write `start: relaxed`"
    if not mesh.segments:
        relaxed = x[0] + mesh.relaxed(drive.actuation[0])
        text = ", ".join(f"{v:.6g}" for v in relaxed[:12]) + (", ..." if relaxed.size > 12 else "")
        proposal = f"a start without tension is [{text}], or {proposal}"
    raise SceneError(
        f"start.displacement: {mesh.name_of(worst)} is pulled by {abs(g):g} N, {-margins[worst]:g} N more than its "
        f"{side} friction {bound:g} N; {proposal}"
    )


def _check_planar_start(scene: Scene) -> None:
    mesh, drive, x = scene.mesh, scene.commands, scene.start_displacement
    tension = mesh.stiffness[:, None] * (mesh.elongation(x) - drive.actuation[0].reshape(-1, 2))
    force = mesh.spring_force(tension)
    friction = drive.targets[0, 2 * mesh.springs :].reshape(mesh.contacts, -1)
    normals = scene.directions
    load = np.linalg.norm(force, axis=1)[:, None] if normals.size == 0 else force @ normals.T
    excess = (load - friction).max(axis=1) - _ROUNDING * (np.abs(tension).sum() + friction.max(axis=1))
    worst = int(np.argmax(excess))
    if excess[worst] > 0.0:
        raise SceneError(
            f"start.displacement: contact {worst} is pulled by [{force[worst, 0]:g}, {force[worst, 1]:g}] N, "
            f"{excess[worst]:g} N more than its friction; `start: relaxed` is a start without tension"
        )
