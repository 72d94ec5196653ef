"""Sensor readings of a crawler: positions, velocities and forces at its joints and contacts.

A node reads them at every tick; on a line a single compiled call reads all of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..body.body import Body
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
                ground on the root and tensions [N]; shape (3, 1 + J), in the plane (3, 2 + 2 J).
            of_contacts: output: positions [m], velocities [m/s] and forces of the ground [N], shape (3, M), in the
                plane (3, 2 M).
        """
        body = self._body
        if body.dimension == 2:
            self._read_planar(crawler, seconds, of_joints, of_contacts)
            return
        state: Any = crawler._state
        read_records(state.contacts, state.springs, self.joints, self.seen, seconds, of_joints, of_contacts)
        self._read_segments(crawler, of_joints)

    def _read_segments(self, crawler: Crawler, of_joints: np.ndarray) -> None:
        """Read elongations and tensions of segments, bitwise the sums of `Body.joint_sum`."""
        if self._body.segments:
            links = self._body.link_springs.size
            of_joints[0, 1 + links :] = crawler.joint_elongation[links:]
            of_joints[2, 1 + links :] = crawler.joint_tension[links:]

    def _read_planar(self, crawler: Crawler, seconds: float, of_joints: np.ndarray, of_contacts: np.ndarray) -> None:
        x, force, velocity = crawler.displacement, crawler.spring_force, crawler.gained / seconds
        if crawler.loads.size:  # the ground carries the loads, too
            force = force + crawler.loads
        root, (first, second), shown = slice(self._root, self._root + 1), self._pairs.T, self.shown
        of_joints[0] = np.concatenate((x[root], crawler.joint_elongation)).ravel()
        of_joints[1] = np.concatenate((velocity[root], velocity[second] - velocity[first])).ravel()
        of_joints[2] = np.concatenate((-force[root], crawler.joint_tension)).ravel()
        of_contacts[0] = (self._body.position + x)[shown].ravel()
        of_contacts[1] = velocity[shown].ravel()
        of_contacts[2] = -force[shown].ravel()


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
