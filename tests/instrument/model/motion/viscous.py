"""Bodies that turn, whose points creep in a thin viscous liquid: a reference without implicit steps or events.

Each point moves along the force on it, as fast as the force exceeds its isotropic friction, divided by the stiffness of
all that meets there. Where commands are slow, the path is that of the rate-independent body, and where the body jumps,
that of its jump.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp


def _side(vectors: np.ndarray) -> np.ndarray:
    """Turn vectors to the left by a right angle, shape (K, 2)."""
    return np.column_stack((-vectors[:, 1], vectors[:, 0]))


def creep(document: dict[str, Any], place: np.ndarray, times: list[float], seconds: float) -> np.ndarray:
    """Let the points creep while commands go from waypoint to waypoint, straight in between.

    Args:
        document: the scene's, with links, joints and isotropic friction; loads, if any, are constant.
        place: of the points at the first time, shape (N, 2) [m].
        times: between which commands are followed, in the drive's time [s].
        seconds: how long the liquid has for each of the drive's [1].

    Returns:
        Where they are at the last time, shape (N, 2) [m].
    """
    body, drive = document["body"], document["drive"]
    links, joints = np.array(body["links"]["between"]), np.array(body["joints"]["between"]).reshape(-1, 3)
    k, c = np.array(body["links"]["stiffness"]), np.array(body["joints"]["stiffness"])
    friction, at, rows = np.array(document["friction"]["isotropic"]), drive["times"], np.array(drive["actuation"])
    loads = np.array(drive["loads"][0]) if "loads" in drive else np.zeros(place.shape)

    def shape(x: np.ndarray) -> tuple[np.ndarray, ...]:
        first, second = x[joints[:, 1]] - x[joints[:, 0]], x[joints[:, 2]] - x[joints[:, 1]]
        angle = np.arctan2((_side(first) * second).sum(axis=1), (first * second).sum(axis=1))
        return np.hypot(*(x[links[:, 1]] - x[links[:, 0]]).T), angle, first, second

    length, bend, first, second = shape(np.array(body["points"]))
    drag = np.zeros(place.shape[0])
    np.add.at(drag, links, k[:, None])
    for ends, arm in ((joints[:, :2], first), (joints[:, 1:], second)):
        np.add.at(drag, ends, (c / (arm**2).sum(axis=1))[:, None])

    def velocity(now: float, flat: np.ndarray) -> np.ndarray:
        x, force = flat.reshape(-1, 2), loads.copy()
        command = np.array([np.interp(now / seconds, at, column) for column in rows.T])
        size, angle, first, second = shape(x)
        tension = k * (size - length - command[: k.size])
        moment = c * (np.remainder(angle - bend - command[k.size :] + np.pi, 2.0 * np.pi) - np.pi)
        pull = (tension / size)[:, None] * (x[links[:, 1]] - x[links[:, 0]])
        pushes = [(m / (a**2).sum(axis=1))[:, None] * _side(a) for m, a in ((-moment, first), (moment, second))]
        for ends, on in ((links, pull), (joints[:, :2], pushes[0]), (joints[:, 1:], pushes[1])):
            np.add.at(force, ends[:, 0], on)
            np.add.at(force, ends[:, 1], -on)
        most = np.hypot(*force.T)
        return ((np.maximum(most - friction, 0.0) / np.maximum(most, 1e-300) / drag)[:, None] * force).ravel()

    flat = place.ravel()
    for begin, end in itertools.pairwise(times):
        span = (begin * seconds, end * seconds)
        flat = solve_ivp(velocity, span, flat, method="LSODA", rtol=1e-7, atol=1e-10, max_step=np.ptp(span) / 20).y[
            :, -1
        ]
    return flat.reshape(-1, 2)
