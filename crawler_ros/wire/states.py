"""The names in joint_states and contact_states, and the positions of stations computed from joint_states."""

from __future__ import annotations

import numpy as np

from crawler_model.body.body import Body
from crawler_model.body.names import name_each, name_every_contact, name_joints
from crawler_model.body.plan import Plan
from crawler_model.body.segment import Segment
from crawler_model.body.turning_tree import TurningTree

_AXES = ("/x", "/y")
_ROUNDING = 1e-9
"""Lengths that differ by less than this part are equal [1], and so are lengths shorter than it [m]."""

_NEAR = 1e-12
"""A tension is also passed at a knot of a curve if it is passed this far before and behind it, as part of it [1]."""


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
    return name_each("contact", body.isolated.size) + ends


def joint_state_names(body: Body) -> list[str]:
    """Name the entries of joint_states.

    Args:
        body: the body.

    Returns:
        The root, then the joints; in the plane x and y of each. For a body that turns x, y and yaw of the root, links,
        joints, and the angles that no joint has.
    """
    if body.turning is not None:
        first, *others = free_angle_names(TurningTree(body))
        return [*_each_axis(station_names(body)[:1], body), first, *name_joints(body), *others]
    return _each_axis([station_names(body)[0], *name_joints(body)], body)


def free_angle_names(tree: TurningTree) -> list[str]:
    """Name the angles of a body that turns that no joint has.

    Args:
        tree: its tree.

    Returns:
        One name per free branch: "contact_0/yaw" for the first link's angle from the x axis, "link_4/yaw" for others.
    """
    links = [tree.branches[i].link for i in tree.free[1:]]
    return ["contact_0/yaw", *(f"link_{link}/yaw" for link in links)]


def find_command(scene: Plan, joints: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Find the command in force from the states of a robot: the rest lengths of linear springs are L = z - T/k.

    Args:
        scene: the body and the columns of its commands.
        joints: positions, velocities and efforts of joint_states, shape (3, W).
        row: what the command is taken to be, shape (C,): friction and loads cannot be measured at rest, nor the lengths
            of springs that are slack, stall or have hysteresis and the strains of segments of several stiffnesses. If a
            strain varies along a segment, states show only its mean, and with backlash only an interval of the command.

    Returns:
        The row, with the rest lengths that differ from it by more than rounding, shape (C,).
    """
    body, columns = scene.body, scene.columns
    begin = body.dimension if body.turning is None else 3
    count = columns.links if body.segments else columns.lengths
    z = joints[0, begin : begin + count]
    found = _find_lengths(body, z, joints[2, begin : begin + count], row)
    for k, segment in enumerate(body.segments):
        size = int(columns.actuation_sizes[count + k])
        elongation, _, tension = joints[:, begin + count + k]
        taken = row[found.size : found.size + size]
        found = np.concatenate((found, _find_strains(body, segment, elongation, tension, taken)))
        z = np.concatenate((z, np.full(size, elongation)))
    row = row.copy()
    moved = np.abs(found - row[: found.size]) > _ROUNDING * (np.abs(z) + np.abs(row[: found.size]) + _ROUNDING)
    row[: found.size][moved] = found[moved]
    return row


def _find_lengths(body: Body, z: np.ndarray, tension: np.ndarray, taken: np.ndarray) -> np.ndarray:
    """Find the commanded lengths of links and joints, with a choice where forces do not determine them."""
    stiffness = body.stiffness[body.link_springs] if body.segments else body.stiffnesses
    found = z - tension / np.repeat(stiffness, z.size // max(stiffness.size, 1))
    springs = body.link_springs.tolist()
    for bend in body.bends:
        if bend.spring in springs:
            i = springs.index(bend.spring)
            alone = float(tension[i] - bend.passive(z[i]))
            ends = [at for side in (-1, 1) for at in bend.actuator.reach(alone + side * _NEAR * max(abs(alone), 1.0))]
            known = len(ends) == 2 and ends[1] - ends[0] <= 1e-6 * abs(ends[0]) + _ROUNDING  # else it is flat there
            length, slack = z[i] - 0.5 * (ends[0] + ends[1]) if known else taken[i], 0.5 * bend.backlash
            found[i] = taken[i] if bend.sliders else np.clip(taken[i], length - slack, length + slack)
    return found


def _find_strains(body: Body, segment: Segment, elongation: float, tension: float, taken: np.ndarray) -> np.ndarray:
    """Find the strains of a segment from its elongation and its mean tension, with a choice where it bends."""
    stiffness = body.stiffness[segment.springs]
    bent = {bend.spring for bend in body.bends}
    if not bent.isdisjoint(range(body.springs)[segment.springs]) or np.ptp(stiffness) > _ROUNDING * stiffness[0]:
        return taken
    mean = (elongation - stiffness.size * tension / stiffness[0]) / segment.length
    return taken + (mean - taken.mean())


def shown_contacts(body: Body) -> np.ndarray:
    """List the contacts that contact_states holds.

    Args:
        body: the body.

    Returns:
        The isolated ones, then each segment's: all of them, or `shown` evenly spaced ones. One that parts share is
        listed once.
    """
    parts = [body.isolated]
    for segment in body.segments:
        count = min(segment.shown or segment.elements + 1, segment.elements + 1)
        parts.append(segment.first + np.round(np.linspace(0, segment.elements, count)).astype(np.int64))
    together = np.concatenate(parts).astype(np.int64)
    return together[np.sort(np.unique(together, return_index=True)[1])]


def contact_names(body: Body) -> list[str]:
    """Name the entries of contact_states.

    Args:
        body: the body.

    Returns:
        One name per shown contact; in the plane x and y of each.
    """
    names = name_every_contact(body)
    return _each_axis([names[c] for c in shown_contacts(body)], body)


def first_stations(body: Body) -> np.ndarray:
    """Find for each station the first one at the same contact: itself, unless parts share the contact.

    Args:
        body: the body.

    Returns:
        Indices of stations, shape (Q,).
    """
    _, first, which = np.unique(body.stations, return_index=True, return_inverse=True)
    return np.asarray(first[which.ravel()])


def tree_of_joints(body: Body) -> list[tuple[int, int, int, float]]:
    """Order the joints along a tree that starts at the root; joints that close a loop are left out.

    Args:
        body: the body.

    Returns:
        For each other station, if it is the first at its contact: the station before it, the station itself, the joint
        between them, and 1.0 if that joint goes from the former to the latter, else -1.0.
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
        self._dimension, self._position = body.dimension, body.position
        self._tree = None if body.turning is None else TurningTree(body)
        self.size = len(joint_state_names(body))
        """Number of positions in joint_states."""
        self._stations = body.stations.size
        self._first = first_stations(body)
        self._steps = tree_of_joints(body)

    def read(self, values: np.ndarray) -> np.ndarray:
        """Add up root and joints.

        Args:
            values: positions of joint_states; unless the body turns, also velocities.

        Returns:
            One per station, in the plane two.
        """
        if self._tree is not None:
            first, last = self._position[0] + values[:2], values.size + 1 - len(self._tree.free)
            free = np.append(values[2], values[last:])
            return self._tree.find_places(first, values[3:last], free) - self._position
        table = np.asarray(values).reshape(-1, 2) if self._dimension == 2 else np.asarray(values)
        result = np.zeros((self._stations, *table.shape[1:]))
        result[0] = table[0]
        for known, new, joint, sign in self._steps:
            result[new] = result[known] + sign * table[1 + joint]
        return result[self._first]
