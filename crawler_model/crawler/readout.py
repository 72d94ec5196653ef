"""Sensor readings of a crawler: positions, velocities and forces at its joints and contacts.

A node reads them at every tick; on a line a single compiled call reads all of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..body.body import Body
from ..body.turning import measure_angles, wrap
from ..body.turning_tree import TurningTree
from ..compiled import compiled
from ..motion.line.records import zeros
from .crawler import Crawler

SEEN = np.dtype([("contact", np.int64), ("home", np.float64)], align=True)
"""A contact that is read, and its reference position [m]."""


class Readout:
    """Readings of the root (the first station), the joints and some contacts of crawlers that share a body."""

    def __init__(self, body: Body, shown: np.ndarray) -> None:
        """Find the contacts and springs of each joint.

        Args:
            body: the body.
            shown: the contacts to read, shape (M,).
        """
        self._body = body
        self.shown = shown
        self._root = int(body.stations[0])
        self._pairs = body.stations[body.joints]
        self._tree = None if body.turning is None else TurningTree(body)
        if body.dimension == 1:
            springs = [*body.link_springs, *(s.first_spring for s in body.segments)]
            root = [[self._root, 0, 0]]
            self.joints = np.vstack((root, np.column_stack((self._pairs, springs)))).astype(np.int64)
            self.seen = zeros(shown.size, SEEN)
            self.seen["contact"], self.seen["home"] = shown, body.position[shown]

    def read(self, crawler: Crawler, seconds: float, of_joints: np.ndarray, of_contacts: np.ndarray) -> None:
        """Read positions, mean velocities and efforts.

        Args:
            crawler: the crawler.
            seconds: duration of its last command [s]; infinite before the first command.
            of_joints: output: displacement of the root and elongations [m]; their velocities [m/s]; force of the
                ground on the root and tensions [N]; shape (3, 1 + J), in the plane (3, 2 + 2 J). For a body that turns
                two entries for the root, the angle of the first link [rad], elongations of links, angles of joints,
                and the other angles of its `TurningTree`; the effort of angles is a torque [N m].
            of_contacts: output: positions [m], velocities [m/s] and forces of the ground [N], shape (3, M), in the
                plane (3, 2 M).
        """
        body = self._body
        if body.dimension == 2:
            self._read_planar(crawler, seconds, of_joints, of_contacts)
            return
        state: Any = crawler._state
        read_records(state.contacts, state.springs, self.joints, self.seen, seconds, of_joints, of_contacts)
        if body.segments:  # bitwise the sums of `Body.joint_sum`
            links = body.link_springs.size
            of_joints[0, 1 + links :] = crawler.joint_elongation[links:]
            of_joints[2, 1 + links :] = crawler.joint_tension[links:]

    def _read_planar(self, crawler: Crawler, seconds: float, of_joints: np.ndarray, of_contacts: np.ndarray) -> None:
        """Read a body in the plane; velocities are differences over the command."""
        body, tree, root = self._body, self._tree, self._root
        x, velocity, ground = crawler.displacement, crawler.gained / seconds, _force_of_ground(crawler)
        elongation = crawler.joint_elongation
        angles = turned = np.zeros(0)
        if tree is None:
            first, second = self._pairs.T
            rate = velocity[second] - velocity[first]
        else:
            before, links = x - crawler.gained, body.springs
            change = elongation - body.elongation(before)
            change[links:] = wrap(change[links:])
            rate = change / seconds
            angles = tree.find_free_angles(body.position + x)
            turned = wrap(angles - tree.find_free_angles(body.position + before)) / seconds
        none = np.zeros(angles.size)
        of_joints[0] = np.concatenate((x[root], angles[:1], elongation.ravel(), angles[1:]))
        of_joints[1] = np.concatenate((velocity[root], turned[:1], rate.ravel(), turned[1:]))
        of_joints[2] = np.concatenate((ground[root], none[:1], crawler.joint_tension.ravel(), none[1:]))
        of_contacts[0] = (body.position + x)[self.shown].ravel()
        of_contacts[1] = velocity[self.shown].ravel()
        of_contacts[2] = ground[self.shown].ravel()


def find_turn(crawler: Crawler) -> float:
    """Compute by how much the heading turned in the last command, less than half a turn.

    Args:
        crawler: the crawler.

    Returns:
        The angle [rad]; 0 for bodies that do not turn.
    """
    turning = crawler.body.turning
    if turning is None:
        return 0.0
    place, heading = crawler.body.position + crawler.displacement, turning.heading[None]
    return float(wrap(measure_angles(place, heading) - measure_angles(place - crawler.gained, heading))[0])


def _force_of_ground(crawler: Crawler) -> np.ndarray:
    """Compute the force of the ground on each contact in the plane, which carries the loads, too, (N, 2) [N]."""
    force = crawler.spring_force
    return -(force + crawler.loads) if crawler.loads.size else -force


@compiled
def read_records(contacts, springs, joints, seen, seconds, of_joints, of_contacts):
    """Read the root, the joints (without the sums over segments) and some contacts of a body on a line.

    Args:
        contacts: CONTACT, shape (N,).
        springs: SPRING, shape (S,).
        joints: the two contacts of each joint and its spring, after a first row that starts with the root contact,
            shape (1 + J, 3).
        seen: SEEN, the contacts to read, shape (M,).
        seconds: time in which the displacement was gained [s].
        of_joints: output: displacement of the root and elongations [m]; their mean velocities [m/s]; the force of
            the ground on the root and tensions [N]; shape (3, 1 + J).
        of_contacts: output: positions [m], mean velocities [m/s] and forces of the ground [N], shape (3, M).
    """
    root = contacts[joints[0, 0]]
    of_joints[0, 0] = root.x
    of_joints[1, 0] = root.gained / seconds
    of_joints[2, 0] = 0.0 - (root.force + root.load)
    for joint in range(1, joints.shape[0]):
        first, second, spring = contacts[joints[joint, 0]], contacts[joints[joint, 1]], springs[joints[joint, 2]]
        of_joints[0, joint] = spring.elongation
        of_joints[1, joint] = second.gained / seconds - first.gained / seconds
        of_joints[2, joint] = spring.tension
    for i in range(seen.shape[0]):
        c = contacts[seen[i].contact]
        of_contacts[0, i] = seen[i].home + c.x
        of_contacts[1, i] = c.gained / seconds
        of_contacts[2, i] = 0.0 - (c.force + c.load)
