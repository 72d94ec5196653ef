"""How slow is slow enough: the inertia number of a path, from masses on which no motion depends.

A contact of mass m whose velocity jumps by dv, where it starts, stops or the drive has a corner, would swing with a
force of dv sqrt(K m), K being the stiffness that holds it. The inertia number is the largest ratio of this force to the
friction against sliding forward and backward. It tells by how much a robot with these masses deviates from the model,
and is proportional to the speed of the drive.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..body.body import Body
from ..body.drive import NS
from ..body.plan import Plan
from ..crawler.budget import default_budget
from ..motion.account import empty_account
from ..motion.follow import build_motion
from ..motion.pieces import FROM, HEADER, PIECES_A_RAMP, RAMP, UNTIL, follow_pieces
from ..theory.uniqueness import find_blocks

UNDAMPED, DAMPED, BOUND = 0.25, 0.1, 0.4
"""Relative deviation of the gain, per inertia number, of lightly and of well damped bodies, and what 19 of 20 runs stay
below: `python -m benchmarks inertia` measures all three."""
PREDICTABLE = 0.3
"""Largest inertia number up to which the deviation is proportional to it."""
_WISH = 0.01
_MOST_CONTACTS, _MOST_NUMBERS = 1000, 4_000_000
"""Contacts of a body whose pieces are followed, and numbers of the pieces of a call."""
_ROUNDING, _SHORTEST = 1e-9, 1e-9
"""Relative difference of numbers that are taken to be equal, and part of a ramp below which a piece is rounding."""


@dataclass(frozen=True)
class Inertia:
    """The inertia number of a run.

    Attributes:
        number: r, the largest of |dv| sqrt(K m) / (F + B) over contacts and events [1].
        time: when that contact starts, stops or changes its velocity [s]; None where nothing moves.
        contact: the contact, counted along the body; None where nothing moves.
        period_for_1_percent: period from which on the deviation stays below 1 % [s]; for a drive without a period its
            duration, None without a drive.
    """

    number: float
    time: float | None
    contact: int | None
    period_for_1_percent: float | None

    @property
    def deviation(self) -> tuple[float, float] | None:
        """Deviation of the gain to expect, relative: well damped and undamped; None if it is not to be predicted."""
        return (DAMPED * self.number, UNDAMPED * self.number) if self.number <= PREDICTABLE else None

    @property
    def bound(self) -> float | None:
        """Deviation below which 19 of 20 runs stay [1]; None if it is not to be predicted."""
        return BOUND * self.number if self.number <= PREDICTABLE else None

    def summary(self) -> dict[str, Any]:
        """Build the JSON object `inertia` of all commands.

        Returns:
            Plain numbers and lists.
        """
        deviation = self.deviation
        return {
            "number": self.number,
            "time": self.time,
            "contact": self.contact,
            "deviation": None if deviation is None else list(deviation),
            "bound": self.bound,
            "period_for_1_percent": self.period_for_1_percent,
        }

    def describe(self, body: Body) -> str:
        """Describe the number in a line.

        Args:
            body: the body, for the name of the contact.

        Returns:
            The number, where and when it occurs, what it means, and how slow is slow enough.
        """
        if self.contact is None:
            return "inertia number 0: nothing moves"
        text = f"inertia number {self.number:.3g} ({body.name_of(self.contact)} at {self.time:.4g} s)"
        if self.deviation is None or self.bound is None:
            text = f"{text}: above {PREDICTABLE:g}, how far masses change the gain is not to be predicted"
        else:
            low, high = (100.0 * value for value in self.deviation)
            text = f"{text}: masses change the gain by about {low:.2g} % (well damped) to {high:.2g} % (undamped), "
            text = f"{text}rarely by more than {100.0 * self.bound:.2g} %"
        return f"{text}; less than 1 % where the drive takes at least {_slowing(self.number):.3g} times as long"


def _slowing(number: float) -> float:
    """Compute how many times as long a drive has to take for the deviation to stay below 1 % [1]."""
    return UNDAMPED * number / _WISH


def _find_largest(jump: np.ndarray, friction: np.ndarray, root: np.ndarray) -> tuple[float, int, int]:
    """Find the largest inertia number, its event and its contact; contacts without friction do not count.

    `jump` of velocities [m/s], NaN if unknown, and `friction`, both ways [N], are of E events; `root` is sqrt(K m).
    """
    size = np.abs(jump) if jump.ndim == 2 else np.linalg.norm(jump, axis=2)
    ratio = np.divide(size * root, friction, out=np.zeros(size.shape), where=(friction > 0.0) & np.isfinite(size))
    first = int(np.argmax(ratio.ravel() >= ratio.max() * (1.0 - _ROUNDING)))  # the first of equal ones
    event, contact = np.unravel_index(first, ratio.shape)
    return float(ratio[event, contact]), int(event), int(contact)


def stiffness_at_contacts(body: Body) -> np.ndarray:
    """Compute the stiffness that holds each contact while the others stand.

    Args:
        body: the body.

    Returns:
        K, shape (N,) [N/m]; for a body that turns an upper bound.
    """
    held = np.bincount(body.ends.ravel(), np.repeat(body.stiffness, 2), body.contacts)
    if body.turning is not None and body.turning.joints.size:
        a, b, c = body.turning.joints.T
        first, second = (1.0 / np.linalg.norm(body.position[p] - body.position[b], axis=1) for p in (a, c))
        for point, slope in ((a, first), (b, first + second), (c, second)):
            np.add.at(held, point, body.turning.joint_stiffness * slope**2)
    return held


class InertiaMeter:
    """Keeps the largest inertia number of a run in progress.

    Bodies on a line have a twin that follows the same ramps and notes the pieces of its path, so that the run itself
    stays as it is, to the bit. In the plane, on ground that changes with place or elongation and of very long bodies,
    mean velocities of ramps stand for velocities of pieces: the velocities before and after each ramp are compared, as
    its event lies within it.
    """

    def __init__(self, plan: Plan, masses: np.ndarray) -> None:
        """Begin at the start of a scene.

        Args:
            plan: the scene.
            masses: of each contact, shape (N,) [kg].
        """
        self._plan, body = plan, plan.body
        self._root = np.sqrt(stiffness_at_contacts(body) * masses)
        self.target, self._x = np.array(plan.drive.targets[0]), plan.start_displacement
        """The target in force, shape (F,), and the displacement."""
        self.follows_pieces = body.dimension == 1 and plan.ground.track is None and body.contacts <= _MOST_CONTACTS
        self._twin: tuple[Any, Any, Any] | None = None
        if self.follows_pieces:
            motion: Any = build_motion(plan)
            self._twin = motion, motion.start(self._x, self.target), motion.scratch()
        self._before = np.zeros((1 if self.follows_pieces else 2, *self._x.shape))  # the last velocities
        self._worst = 0.0, 0.0, -1

    def add_ramps(
        self,
        targets: np.ndarray,
        after_ns: int,
        ends_ns: np.ndarray,
        x: np.ndarray | None = None,
        jumped: Sequence[int] = (),
    ) -> None:
        """Add ramps.

        Args:
            targets: their ends, shape (V, F).
            after_ns: when the first one begins [ns].
            ends_ns: when each ends, shape (V,) [ns]; ramps of no duration have no velocity and do not count.
            x: displacement after each, shape (V, N), in the plane (V, N, 2) [m]; needed unless `follows_pieces`.
            jumped: ramps in which the body jumped, which has no velocity.
        """
        begins = np.concatenate(([after_ns], ends_ns[:-1]))
        rows = np.vstack((self.target, targets))
        self.target = rows[-1].copy()
        if self._twin is None:
            assert x is not None
            self._add_mean_velocities(rows, begins, ends_ns, x, jumped)
            return
        size = max(_MOST_NUMBERS // (PIECES_A_RAMP * (HEADER + 2 * self._plan.body.contacts)), 1)
        for first in range(0, ends_ns.size, size):
            part = slice(first, first + size)
            self._add_pieces(rows[first : first + size + 1], begins[part], ends_ns[part])

    def stop(self, at_ns: int) -> None:
        """Note that the drive has ended, so that nothing moves any more.

        Args:
            at_ns: when it ended [ns].
        """
        self._note(np.zeros((1, *self._x.shape)), self._friction(self.target[None], self._x[None]), np.array([at_ns]))

    def result(self) -> Inertia:
        """Find the largest inertia number so far.

        Returns:
            The number, with what it means.
        """
        number, at_ns, contact = self._worst
        drive = self._plan.drive
        period = drive.period or (float(drive.times[-1]) or None)
        slow = None if period is None else period * _slowing(number)
        return Inertia(number, at_ns / NS if contact >= 0 else None, contact if contact >= 0 else None, slow)

    def _add_pieces(self, rows: np.ndarray, begins: np.ndarray, ends: np.ndarray) -> None:
        assert self._twin is not None
        motion, state, scratch = self._twin
        n, springs = self._plan.body.contacts, self._plan.body.springs
        account = empty_account()
        records = np.empty((ends.size, 2 * n + springs))
        targets = np.ascontiguousarray(rows[1:])
        met = follow_pieces(motion, state, scratch, targets, default_budget(self._plan.body), account, records)
        seconds = (ends - begins) / NS
        pauses = np.setdiff1d(np.arange(ends.size), met[:, RAMP])  # nothing is commanded there, and nothing moves
        still = np.zeros((pauses.size, met.shape[1]))
        still[:, RAMP], still[:, UNTIL] = pauses, 1.0
        met = np.concatenate((met, still))
        met = met[np.argsort(met[:, RAMP], kind="stable")]
        ramp = met[:, RAMP].astype(np.int64)
        kept = (met[:, UNTIL] - met[:, FROM] > _SHORTEST) & (seconds[ramp] > 0.0)
        met, ramp = met[kept], ramp[kept]
        part = met[:, FROM, None]
        friction = self._friction(rows)
        held = friction[ramp] + part * (friction[ramp + 1] - friction[ramp])
        velocity = met[:, HEADER : HEADER + n] / seconds[ramp, None]
        self._note(velocity, held, begins[ramp] + met[:, FROM] * (ends - begins)[ramp])

    def _add_mean_velocities(
        self, rows: np.ndarray, begins: np.ndarray, ends: np.ndarray, x: np.ndarray, jumped: Sequence[int]
    ) -> None:
        places = np.concatenate((self._x[None], x))
        self._x = x[-1]
        lasts = ends > begins
        moved = np.diff(places, axis=0)
        moved[list(jumped)] = np.nan
        velocity = moved[lasts] / ((ends - begins) / NS)[lasts].reshape(-1, *(1,) * (x.ndim - 1))
        self._note(velocity, self._friction(rows[:-1], places[:-1])[lasts], begins[lasts])

    def _note(self, velocity: np.ndarray, held: np.ndarray, at_ns: np.ndarray) -> None:
        """Note the velocities after events, shape (E, N) or (E, N, 2), with the friction and the times there."""
        if not len(velocity):
            return
        gap, path = len(self._before), np.concatenate((self._before, velocity))
        self._before = path[-gap:]
        number, event, contact = _find_largest(path[gap:] - path[:-gap], held, self._root)
        if number > self._worst[0] * (1.0 + _ROUNDING):
            self._worst = number, float(at_ns[event]), contact

    def _friction(self, rows: np.ndarray, x: np.ndarray | None = None) -> np.ndarray:
        """Compute the sum of the frictions of each contact against sliding forward and backward, shape (V, N) [N].

        In a segment it is the sum of the whole segment, along which a jump of velocity wears off as a wave, on any
        mesh.
        """
        plan, body = self._plan, self._plan.body
        n, bounds = body.contacts, rows[:, body.lengths :]
        if body.dimension == 2:
            each = max(plan.columns.planar or 1, 1)
            held = 2.0 * bounds[:, : each * n].reshape(-1, n, each).mean(axis=2)
            if x is not None:
                held = plan.ground.scale_friction(held[..., None], body.position + x)[..., 0]
        elif plan.ground.track is not None and x is not None:
            forward, backward, _ = plan.ground.track.local_bounds(bounds, body.position, x)
            held = forward + backward
        else:
            held = bounds[:, :n] + bounds[:, n : 2 * n]
        for block in find_blocks(body) if body.segments else ():
            held[:, block] = held[:, block].sum(axis=1, keepdims=True)
        return held


def start_meter(plan: Plan) -> InertiaMeter | None:
    """Start to measure the inertia number of a run.

    Args:
        plan: the scene.

    Returns:
        The meter; None for a scene without masses and weights.
    """
    masses = plan.ground.masses
    return None if masses is None else InertiaMeter(plan, masses)
