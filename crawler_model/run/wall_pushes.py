"""How hard contacts push against walls, at the waypoints of a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..body.plan import Plan


@dataclass(frozen=True)
class WallPush:
    """The push of a contact on a wall at an instant; friction leaves an interval open.

    The ground under a contact at a wall ahead may hold any part of the spring force g between its bounds, -mu_minus and
    mu_plus. The push is therefore any force in [g - mu_plus, g + mu_minus] that is not negative; behind in the same
    way.

    Attributes:
        time: simulated time [s].
        contact: the contact, counted along the body.
        wall: number of the wall in `ground.walls`.
        least: smallest push [N].
        most: largest push [N].
    """

    time: float
    contact: int
    wall: int
    least: float
    most: float


def find_pushes(
    scene: Plan, time: np.ndarray, x: np.ndarray, tension: np.ndarray, target: np.ndarray
) -> list[WallPush]:
    """Find the pushes of all contacts that stand at walls.

    Args:
        scene: the scene.
        time: times, shape (W,) [s].
        x: displacement at these times, shape (W, N) [m].
        tension: at the same times, shape (W, S) [N].
        target: targets in force, shape (W, S + 2 N) or with loads (W, S + 3 N) [m, N].

    Returns:
        The pushes in order of time; none without walls.
    """
    body, track = scene.body, scene.ground.track
    if track is None or track.walls is None:
        return []
    at_wall = track.walls.find_rooms(body.position, x) == 0.0
    pushes = []
    for k in np.flatnonzero(at_wall.any(axis=(0, 2))):
        force = body.spring_force(tension[k])
        forward, backward, _ = track.local_bounds(target[k, body.springs :], body.position, x[k])
        for i, side in np.argwhere(at_wall[:, k].T):
            g, ahead, behind = (force, forward, backward) if side == 0 else (-force, backward, forward)
            least, most = max(float(g[i] - ahead[i]), 0.0), max(float(g[i] + behind[i]), 0.0)
            pushes.append(WallPush(float(time[k]), int(i), int(track.walls.index[side, i]), least, most))
    return pushes
