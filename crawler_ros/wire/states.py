"""The names in joint_states and contact_states, and the positions of stations computed from joint_states."""

from __future__ import annotations

import numpy as np

from crawler_model.body.body import Body
from crawler_model.body.names import name_contacts, name_every_contact, name_joints

_AXES = ("/x", "/y")


def _each_axis(names: list[str], body: Body) -> list[str]:
    return names if body.dimension == 1 else [name + axis for name in names for axis in _AXES]


def station_names(body: Body) -> list[str]:
    """Name the stations: contacts, then both ends of each segment.

    Args:
        body: the body.

    Returns:
        One name per station; the first is the root of joint_states.
    """
    ends = [f"{s.name}.{end}" for s in body.segments for end in ("from", "to")]
    return name_contacts(body.isolated.size) + ends


def joint_state_names(body: Body) -> list[str]:
    """Name the entries of joint_states.

    Args:
        body: the body.

    Returns:
        The root, then the joints; in the plane x and y of each.
    """
    return _each_axis([station_names(body)[0], *name_joints(body)], body)


def shown_contacts(body: Body) -> np.ndarray:
    """List the contacts that contact_states holds.

    Args:
        body: the body.

    Returns:
        The isolated ones, then those of each segment: all of them, or `shown` evenly spaced ones.
    """
    parts = [body.isolated]
    for segment in body.segments:
        count = min(segment.shown or segment.elements + 1, segment.elements + 1)
        parts.append(segment.first + np.round(np.linspace(0, segment.elements, count)).astype(np.int64))
    return np.concatenate(parts).astype(np.int64)


def contact_names(body: Body) -> list[str]:
    """Name the entries of contact_states.

    Args:
        body: the body.

    Returns:
        One name per shown contact; in the plane x and y of each.
    """
    names = name_every_contact(body)
    return _each_axis([names[c] for c in shown_contacts(body)], body)


def tree_of_joints(body: Body) -> list[tuple[int, int, int, float]]:
    """Order the joints along a tree that starts at the root; joints that close a loop are left out.

    Args:
        body: the body.

    Returns:
        For each other station: the station before it, the station itself, the joint between them, and 1.0 if that joint
        goes from the former to the latter, else -1.0.
    """
    steps: list[tuple[int, int, int, float]] = []
    neighbours: list[list[tuple[int, int, float]]] = [[] for _ in range(body.stations.size)]
    for joint, (a, b) in enumerate(body.joints.tolist()):
        neighbours[a].append((b, joint, 1.0))
        neighbours[b].append((a, joint, -1.0))
    reached, waiting = {0}, [0]
    for station in waiting:
        for other, joint, sign in neighbours[station]:
            if other not in reached:
                reached.add(other)
                waiting.append(other)
                steps.append((station, other, joint, sign))
    return steps


class StationReader:
    """Computes displacements of the stations from the positions of joint_states."""

    def __init__(self, body: Body) -> None:
        """Order the joints along a tree that starts at the root.

        Args:
            body: the body.
        """
        self._dimension = body.dimension
        self.size = body.dimension * (1 + len(body.joints))
        """Number of positions in joint_states."""
        self._stations = body.stations.size
        self._steps = tree_of_joints(body)

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
