"""The path of a scene at the times of a recording, with its derivatives."""

from __future__ import annotations

import dataclasses

import numpy as np

from crawler_model.body.drive import NS
from crawler_model.errors import CommandError
from crawler_model.scene.scene import Scene

from ...derivative.parameters import Derivatives
from ...derivative.tangent_path import TangentPath, Vertices, build_vertices

_BLOCK = 200_000
"""Derivatives that are computed at a time, so that they stay in the cache of the processor until they are stored."""


def begin_path(
    scene: Scene, derivatives: Derivatives, ticks: np.ndarray, recorded: bool
) -> tuple[TangentPath, Vertices]:
    """Begin a path, and find the ends of its ramps.

    Args:
        ticks: increasing times that end a ramp, shape (K,) [ns].

    Returns:
        The path at its start, and the ends of all ramps up to the last time.
    """
    if not recorded:
        return TangentPath(scene, derivatives), build_vertices(scene.drive, derivatives, 0, ticks)
    bare = dataclasses.replace(derivatives, times=np.zeros((scene.drive.times.size, 0)), period=np.zeros(0))
    vertices = build_vertices(scene.drive, bare, 0, ticks)
    before, after, targets = vertices.before, vertices.after, derivatives.targets
    if targets.strides[0] == 0:  # they are the same at all waypoints, so that one is enough
        before = after = np.zeros(before.shape, before.dtype)
        targets = targets[:1].copy()
    none = np.zeros((before.size, derivatives.start.shape[1]))
    vertices = dataclasses.replace(vertices, before=before, after=after, d_part=none)
    return TangentPath(scene, dataclasses.replace(derivatives, targets=targets)), vertices


def follow_times(
    scene: Scene, derivatives: Derivatives, at: np.ndarray, recorded: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Compute the motion at some times, at the start before 0.

    Args:
        at: increasing, shape (T,) [s].

    Returns:
        Displacements, shape (T, N) [m]; their derivatives, shape (N, P, T); and velocities, shape (T, N) [m/s]. None if
        the motion has too many events.
    """
    ns = np.rint(np.maximum(at, 0.0) * NS).astype(np.int64)
    x, velocity = (np.tile(row, (ns.size, 1)) for row in (scene.start_displacement, np.zeros(scene.body.contacts)))
    dx = np.empty((*derivatives.start.shape, ns.size))
    first = int(np.searchsorted(ns, 0, side="right"))
    dx[..., :first] = derivatives.start[..., None]
    if first == ns.size:
        return x, dx, velocity
    path, vertices = begin_path(scene, derivatives, ns[first:][np.append(True, np.diff(ns[first:]) > 0)], recorded)
    place = np.searchsorted(vertices.time_ns, ns)
    duration = np.diff(vertices.time_ns, prepend=0) / NS
    late = np.where(at > 0.0, at - ns / NS, 0.0)[:, None]
    moves = bool(vertices.d_time.any())
    size = max(1, _BLOCK // dx[..., 0].size)
    for begin in range(0, duration.size, size):
        block = {name: part[begin : begin + size] for name, part in vars(vertices).items()}
        try:
            stretch = path.follow_vertices(Vertices(**block))
        except CommandError:
            return None
        rows = slice(*(first + np.searchsorted(place[first:], (begin, begin + size))))
        own = place[rows] - begin
        speed = stretch.speed[own] / duration[place[rows], None]
        x[rows] = stretch.x[own] + stretch.rest[own] + speed * late[rows]
        velocity[rows] = speed
        moved = stretch.dx[own]
        if moves:
            moved -= speed[:, :, None] * vertices.d_time[place[rows]][:, None, :]
        dx[..., rows] = moved.transpose(1, 2, 0)
    return x, dx, velocity
