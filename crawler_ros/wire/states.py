"""What joint_states and contact_states say of a crawler, and the way back to where its stations stand."""

from __future__ import annotations

import numpy as np

from crawler_model import Scene
from crawler_model.body.body import Body

_AXES = ("/x", "/y")


def _each_axis(names: list[str], mesh: Body) -> list[str]:
    return names if mesh.dimension == 1 else [name + axis for name in names for axis in _AXES]


def station_names(mesh: Body) -> list[str]:
    """Name the stations: contacts, then both ends of each segment.

    Args:
        mesh: the body.

    Returns:
        One name per station; the first is the root of joint_states.
    """
    ends = [f"{s.name}.{end}" for s in mesh.segments for end in ("from", "to")]
    return [f"contact_{i}" for i in range(mesh.isolated.size)] + ends


def joint_names(mesh: Body) -> list[str]:
    """Name the joints.

    Args:
        mesh: the body.

    Returns:
        Each link, then each segment.
    """
    return [f"link_{i}" for i in range(mesh.link_springs.size)] + [s.name for s in mesh.segments]


def joint_state_names(mesh: Body) -> list[str]:
    """Name the entries of joint_states.

    Args:
        mesh: the body.

    Returns:
        The root, then the joints; in the plane x and y of each.
    """
    return _each_axis([station_names(mesh)[0], *joint_names(mesh)], mesh)


def shown_contacts(scene: Scene) -> np.ndarray:
    """List the contacts that contact_states speaks of.

    Args:
        scene: the scene.

    Returns:
        The isolated ones, then those of each segment: all, or as many as `shown` says, evenly.
    """
    mesh = scene.mesh
    parts = [mesh.isolated]
    for part, segment in zip(scene.body.segments, mesh.segments, strict=True):
        count = min(part.shown or segment.elements + 1, segment.elements + 1)
        parts.append(segment.first + np.round(np.linspace(0, segment.elements, count)).astype(np.int64))
    return np.concatenate(parts).astype(np.int64)


def contact_names(scene: Scene) -> list[str]:
    """Name the entries of contact_states.

    Args:
        scene: the scene.

    Returns:
        One name per shown contact; in the plane x and y of each.
    """
    mesh = scene.mesh
    names = {int(c): f"contact_{i}" for i, c in enumerate(mesh.isolated)}
    for segment in mesh.segments:
        names |= {segment.first + j: f"{segment.name}/contact_{j}" for j in range(segment.elements + 1)}
    return _each_axis([names[int(c)] for c in shown_contacts(scene)], mesh)


def tree_of_joints(mesh: Body) -> list[tuple[int, int, int, float]]:
    """Order the joints along a tree that starts at the root; joints that close a loop are left out.

    Args:
        mesh: the body.

    Returns:
        For each other station: the station before it, itself, the joint between, and 1.0 where that joint goes from the
        former to the latter, else -1.0.
    """
    steps: list[tuple[int, int, int, float]] = []
    beside: list[list[tuple[int, int, float]]] = [[] for _ in range(mesh.stations.size)]
    for joint, (a, b) in enumerate(mesh.joints.tolist()):
        beside[a].append((b, joint, 1.0))
        beside[b].append((a, joint, -1.0))
    known, waiting = {0}, [0]
    for station in waiting:
        for other, joint, sign in beside[station]:
            if other not in known:
                known.add(other)
                waiting.append(other)
                steps.append((station, other, joint, sign))
    return steps


class StationReader:
    """Turns the positions of joint_states back into displacements of the stations."""

    def __init__(self, mesh: Body) -> None:
        """Order the joints along a tree that starts at the root.

        Args:
            mesh: the body.
        """
        self._dimension = mesh.dimension
        self._stations = mesh.stations.size
        self._steps = tree_of_joints(mesh)

    def read(self, values: np.ndarray) -> np.ndarray:
        """Add up root and joints.

        Args:
            values: positions (or velocities) of joint_states.

        Returns:
            One per station, in the plane two.
        """
        table = np.asarray(values).reshape(-1, 2) if self._dimension == 2 else np.asarray(values)
        result = np.zeros((self._stations, *table.shape[1:]))
        result[0] = table[0]
        for known, new, joint, sign in self._steps:
            result[new] = result[known] + sign * table[1 + joint]
        return result
