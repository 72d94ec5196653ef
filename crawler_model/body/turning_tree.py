"""A tree of links through all points of a body that turns: from elongations and angles to positions.

The direction of each link of the tree is the direction of the link before it, turned by the reference angle between
them and by the change of that angle. The change belongs to a joint, or, where no joint connects both links, is an angle
of its own. The first link is turned from the x axis. Links that close a loop are not in the tree.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .body import Body
from .turning import measure_angles, wrap


@dataclass(frozen=True)
class Branch:
    """A link of the tree.

    Attributes:
        link: its number.
        start: the point that is reached before it.
        end: the point that it leads to.
        before: number of the branch from whose direction its own is turned; -1 for the x axis.
        joint: the joint whose change of angle turns it; -1 if none does.
        sign: 1.0 if the angle of the joint turns it to the left, -1.0 to the right [1].
        heading: reference angle from the direction before [rad].
        length: reference length [m].
    """

    link: int
    start: int
    end: int
    before: int
    joint: int
    sign: float
    heading: float
    length: float


class TurningTree:
    """The tree of a body that turns, from its first point."""

    def __init__(self, body: Body) -> None:
        """Choose the tree: from joint to joint where they reach, else over any link.

        Args:
            body: a body that turns.
        """
        assert body.turning is not None
        self._position, self._springs = body.position, body.springs
        self.joints = body.lengths - body.springs
        """Number of joints of the body."""
        ends, joints = body.ends.tolist(), body.turning.joints.tolist()
        link_of = {frozenset(pair): link for link, pair in enumerate(ends)}
        branches: list[Branch] = []
        reached = {0}
        while len(reached) < body.contacts:
            found = next(_over_joints(branches, reached, link_of, joints), None) or _over_any(branches, reached, ends)
            branches.append(self._measure(*found, branches))
            reached.add(branches[-1].end)
        self.branches = tuple(branches)
        """The links in an order in which each follows the one before it."""
        self.free = tuple(i for i, branch in enumerate(branches) if branch.joint < 0)
        """The branches that no joint turns, the first one first."""
        self._ways = np.array([[b.start, b.end] for b in branches], np.int64)
        self._free_before = np.array([branches[i].before for i in self.free], np.int64)
        self._free_heading = np.array([branches[i].heading for i in self.free])

    def _measure(
        self, link: int, start: int, end: int, before: int, joint: int, sign: float, branches: list[Branch]
    ) -> Branch:
        """Measure a branch in the reference shape."""
        way = self._position[end] - self._position[start]
        heading = np.arctan2(way[1], way[0])
        if before >= 0:
            first = branches[before]
            way_before = self._position[first.end] - self._position[first.start]
            heading = wrap(heading - np.arctan2(way_before[1], way_before[0]))
        return Branch(link, start, end, before, joint, sign, float(heading), float(np.hypot(*way)))

    def find_free_angles(self, place: np.ndarray) -> np.ndarray:
        """Compute the changes of the angles that no joint has.

        Args:
            place: positions of the points, shape (N, 2) [m].

        Returns:
            Shape (len(free),), in [-pi, pi] [rad].
        """
        angles = np.append(measure_angles(place, self._ways), 0.0)  # the last one, number -1, is the x axis
        return wrap(wrap(angles[np.array(self.free)] - angles[self._free_before]) - self._free_heading)

    def find_places(self, first: np.ndarray, change: np.ndarray, free: np.ndarray) -> np.ndarray:
        """Compute the positions of the points.

        Args:
            first: position of the first point, shape (2,) [m].
            change: elongation of each link [m], then change of the angle of each joint [rad], shape (S + J,).
            free: changes of the other angles, as from `find_free_angles` [rad].

        Returns:
            Shape (N, 2) [m].
        """
        place = np.empty(self._position.shape)
        place[0] = first
        angles, others = np.zeros(len(self.branches) + 1), iter(free.tolist())
        for i, branch in enumerate(self.branches):
            turn = next(others) if branch.joint < 0 else branch.sign * change[self._springs + branch.joint]
            angles[i] = angles[branch.before] + branch.heading + turn
            length = branch.length + change[branch.link]
            place[branch.end] = place[branch.start] + length * np.array([np.cos(angles[i]), np.sin(angles[i])])
        return place


def _over_joints(
    branches: list[Branch], reached: set[int], link_of: dict[frozenset[int], int], joints: list[list[int]]
) -> Iterator[tuple[int, int, int, int, int, float]]:
    """Find links to new points that a joint turns from a link of the tree, the newest first."""
    for i in reversed(range(len(branches))):
        pair = {branches[i].start, branches[i].end}
        for joint, (a, b, c) in enumerate(joints):
            for known, new, sign in ((a, c, 1.0), (c, a, -1.0)):
                if b in pair and known in pair and new not in reached:
                    link = link_of.get(frozenset((b, new)))
                    if link is not None:
                        yield link, b, new, i, joint, sign


def _over_any(
    branches: list[Branch], reached: set[int], ends: list[list[int]]
) -> tuple[int, int, int, int, int, float]:
    """Find any link to a new point; its direction is turned from the link that reached its start."""
    for link, pair in enumerate(ends):
        for start, end in (pair, pair[::-1]):
            if start in reached and end not in reached:
                before = next((i for i, branch in enumerate(branches) if start in (branch.end, branch.start)), -1)
                return link, start, end, before, -1, 1.0
    raise AssertionError("the links of a body connect all of its points")
