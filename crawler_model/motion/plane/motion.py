"""The motion of a body in the plane."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...body.body import Body
from ...body.plan import Plan
from ...body.turning import TURNING_TOLERANCE, measure_angles
from ...errors import CommandError
from ..jump import Jump
from ..state import ACCOUNT_SIZE, AMBIGUOUS, DISSIPATION, LOADS_WORK, OVERSPENT, SPENT, VISITED, WORK
from .elastic import pull, strain
from .frame import Frame, build_frame
from .friction import measure_margins
from .jump import COLLAPSED, jump
from .ramp import LENGTH, MARGIN, PLACE, follow_ramp, force_step
from .translation import is_held

_SHARE = 0.1
"""Part of the tolerance available to the parts of a ramp, as later parts may amplify errors of earlier ones."""

DEFAULT_TOLERANCE = 1e-4
"""Default error of a ramp of vector springs, relative to its change of length."""
_ROUNDING = 1e-13
"""Least tolerance, relative to the size of the body."""
_FAR = 1024.0
"""Displacements of more sizes of the body lose digits."""
_AHEAD = 1e-6
"""Part of a ramp by which commands go on where the body jumps."""
_NEARER, _CONTINUOUS = 16.0, 8.0
"""Commands that go on by a part so much shorter move a body that slides on by so much less at least; one that buckles
moves by the square root of that, one that falls as far."""


@dataclass(eq=False)
class PlanarState:
    """The state of a body in the plane.

    Of vector springs, elongations, tensions and changes of the rest length have the shape (S, 2) instead of (S + J,).

    Attributes:
        frame: the body.
        origin: what the body has travelled, in whole multiples of a length, shape (2,) [m].
        x: displacements from there, shape (N, 2) [m].
        gained: displacement gained in the last command, shape (N, 2) [m].
        command: the command in force, as in a target, shape (C,).
        turned: the yaw, unwrapped, shape (1,) [rad].
        stability: least stability margin of the last command, shape (1,) [1].
    """

    frame: Frame
    origin: np.ndarray
    x: np.ndarray
    gained: np.ndarray
    command: np.ndarray
    turned: np.ndarray
    stability: np.ndarray

    @property
    def displacement(self) -> np.ndarray:
        """Displacement x, shape (N, 2) [m]."""
        return self.origin + self.x

    @property
    def yaw(self) -> float:
        """Direction of the heading, unwrapped [rad]."""
        return float(self.turned[0])

    @property
    def stability_margin(self) -> float:
        """Least stability margin of the last command [1]."""
        return float(self.stability[0])

    @property
    def shape(self) -> np.ndarray:
        """Elongations of the links [m], then changes of the angles of the joints [rad], shape (S + J,)."""
        return self._by_spring(self._strained[1])

    @property
    def tension(self) -> np.ndarray:
        """Tensions of the links [N], then torques of the joints [N m], shape (S + J,)."""
        return self._by_spring(self._strained[0])

    def _by_spring(self, values: np.ndarray) -> np.ndarray:
        return values.reshape(-1, 2) if self.frame.vector else values

    @property
    def _strained(self) -> np.ndarray:
        found = np.empty((2, self.frame.rest.size))
        strain(self.frame, self.command, self.x, found)
        return found

    @property
    def actuation(self) -> np.ndarray:
        """Changes of the rest lengths [m], then of the rest angles [rad], in force, shape (S + J,)."""
        return self._by_spring(self.command[: self.frame.rest.size])

    @property
    def friction(self) -> np.ndarray:
        """Friction in force as in a target, point by point, shape (N,) for discs, else (4 N,) or (m N,) [N]."""
        given = self.command[self.frame.rest.size : self._last]
        return given[::4] if self.frame.vector and self.frame.directions.size == 0 else given

    @property
    def _last(self) -> int:
        """Where friction ends in a command."""
        return self.frame.rest.size + (self.frame.directions.shape[0] or 4) * self.x.shape[0]

    @property
    def bounds(self) -> np.ndarray:
        """The same as `friction`."""
        return self.friction

    @property
    def loads(self) -> np.ndarray:
        """Loads in force, the slope's share included, shape (N, 2) [N]; shape (0, 2) without loads."""
        return self.command[self._last :].reshape(-1, 2)

    @property
    def force(self) -> np.ndarray:
        """Force of links and joints on each point, shape (N, 2) [N]."""
        force, size = np.empty_like(self.x), np.empty(self.x.shape[0])
        pull(self.frame, self.command, self.x, force, size)
        return force - self.loads if self.loads.size else force

    @property
    def contact_state(self) -> np.ndarray:
        """1 if a point slid in the last command, 0 stuck; int8, shape (N,)."""
        return (np.abs(self.gained).max(axis=1) > 0.0).astype(np.int8)

    def margins(self, force: np.ndarray) -> np.ndarray:
        """Compute the distance, along the force, of the forces from the boundary of the admissible friction forces.

        Args:
            force: of links and joints, shape (N, 2) [N].

        Returns:
            Shape (N,) [N].
        """
        margins = np.empty(self.x.shape[0])
        force = np.array(force + self.loads if self.loads.size else force, order="C")
        measure_margins(self.frame, self.command, self.x, force, margins)
        return margins

    def visited_margin(self, force: np.ndarray) -> float:
        """Compute how close all contacts are to sliding at once.

        Args:
            force: of links and joints, shape (N, 2) [N].

        Returns:
            The margin [1].
        """
        total = float(self.friction.reshape(self.x.shape[0], -1).mean(axis=1).sum()) * (1.0 + self.frame.vector)
        return float(np.maximum(self.margins(force), 0.0).sum()) / total if total > 0.0 else 0.0

    def recentre(self, unit: float) -> None:
        """Move the origin to a body that is far from it: forces follow from differences of displacements.

        Args:
            unit: a power of 2 as large as the body [m].
        """
        if max(map(abs, self.x[0].tolist())) > _FAR * unit:
            shift = unit * np.round(self.x.mean(axis=0) / unit)
            self.x -= shift  # exact
            self.origin += shift

    def copy(self) -> PlanarState:
        """Copy the state.

        Returns:
            An independent state with the same numbers.
        """
        arrays = (self.origin, self.x, self.gained, self.command, self.turned, self.stability)
        return PlanarState(self.frame, *(array.copy() for array in arrays))

    def bits(self) -> bytes:
        """Return all numbers as bytes, for comparison.

        Returns:
            The bytes of all arrays, one after another.
        """
        return b"".join(array.tobytes() for array in (self.origin, self.x, self.gained, self.command, self.turned))


@dataclass(frozen=True, eq=False)
class PlaneMotion:
    """A body in the plane, followed by extrapolated implicit steps, to a tolerance.

    Attributes:
        body: the body.
        frame: its arrays.
        tolerance: largest error of a ramp [m].
    """

    methods: ClassVar[tuple[str, ...]] = ("catch_up",)
    samples_margin: ClassVar[bool] = True
    body: Body
    frame: Frame
    tolerance: float

    @functools.cached_property
    def fields(self) -> tuple[Any, ...]:
        """Those of the frame, which Python passes to a kernel in half the time of the frame."""
        return tuple(self.frame)

    @functools.cached_property
    def unit(self) -> float:
        """The least power of 2 that is not shorter than the body [m]."""
        return float(2.0 ** np.ceil(np.log2(np.ptp(self.frame.position, axis=0).max() or 1.0)))

    def start(self, x: np.ndarray, target: np.ndarray) -> PlanarState:
        """Build the state at rest, see `Motion`."""
        x, command = np.array(x, np.float64, order="C"), self.expand(np.array(target, np.float64)[None])[0]
        turns = not self.frame.vector
        yaw = measure_angles(self.frame.position + x, self.frame.heading[None]) if turns else np.zeros(1)
        state = PlanarState(self.frame, np.zeros(2), x, np.zeros_like(x), command, yaw, np.full(1, np.inf))
        state.recentre(self.unit)
        return state

    def expand(self, targets: np.ndarray) -> np.ndarray:
        """Repeat the friction of each disc for its four sides: kernels know quarter ellipses alone.

        Args:
            targets: rows as in `Columns.target`, or derivatives of such rows, shape (V, F, ...).

        Returns:
            The rows of `PlanarState.command`, shape (V, C, ...).
        """
        discs = self.body.contacts if self.frame.vector and self.frame.directions.size == 0 else 0
        return np.take(targets, _columns_of(targets.shape[1], self.frame.rest.size, discs), axis=1)

    def scratch(self) -> np.ndarray:
        """Allocate the velocities with which a ramp begins, see `Motion`."""
        return np.zeros((self.body.contacts, 2))

    def follow(
        self,
        state: PlanarState,
        scratch: np.ndarray,
        targets: np.ndarray,
        exact: bool,
        budget: int,
        account: np.ndarray,
        records: np.ndarray,
    ) -> tuple[Jump, ...]:
        """Follow straight ramps to each of the targets in turn, see `Motion`; `exact` and `budget` have no effect."""
        moving = state.copy()  # it may have nowhere to go
        moving.gained[:] = 0.0
        moving.stability[:] = np.inf
        n, parts = self.body.contacts, self.frame.rest.size
        jumps: list[Jump] = []
        for v, target in enumerate(self.expand(targets)):
            jumps += self._follow_ramp(moving, scratch, target, v, account)
            if records.shape[0]:
                x = moving.displacement
                records[v, : 2 * n] = x.ravel()
                records[v, 2 * n : 4 * n] = (moving.x - (x - moving.origin)).ravel()
                records[v, 4 * n : 4 * n + parts] = moving.tension.ravel()
                if records.shape[1] > 4 * n + parts:
                    lost = account[DISSIPATION] + account[LOADS_WORK]
                    records[v, -SPENT:] = 0.0, 0.0, account[WORK], lost, account[LOADS_WORK]
        moving.recentre(self.unit)
        vars(state).update(vars(moving))
        if account[VISITED] == np.inf:  # no command changed
            account[VISITED] = state.visited_margin(state.force)
        return tuple(jumps)

    def _follow_ramp(
        self, state: PlanarState, velocity: np.ndarray, target: np.ndarray, ramp: int, account: np.ndarray
    ) -> Iterator[Jump]:
        """Follow one ramp through its jumps."""
        arrays = state.x, state.gained, state.command, state.turned
        progress = np.array([0.0, 1.0, self.tolerance, state.stability[0], np.inf])
        velocity[:] = 0.0
        ahead, landed = _AHEAD, -1.0
        while progress[PLACE] < 1.0:
            if follow_ramp(self.fields, arrays, target, self.tolerance, velocity, account, progress):
                break
            place = progress[PLACE]
            if self.body.turning is None:
                if not force_step(self.frame, arrays, target, account, progress):
                    raise CommandError(self._explain(state, place))
                continue
            ahead = 4.0 * ahead if place <= landed else _AHEAD
            part = min(ahead / (1.0 - place), 1.0)
            before = tuple(array.copy() for array in arrays)
            found, contact, distance, loss = jump(self.frame, arrays, target, part, velocity, account)
            if not found:
                raise CommandError(self._explain(state, place))
            progress[PLACE] = landed = 1.0 if part == 1.0 else place + ahead
            account[VISITED] = min(account[VISITED], state.visited_margin(state.force))
            progress[LENGTH] = ahead
            if distance > self.tolerance or not self.body.turning.jumps:
                if not self._falls(before, target, part, velocity, distance):
                    account[OVERSPENT] += distance > self.tolerance  # no part of the ramp keeps the tolerance here
                    if not is_held(self.frame, state.command, state.x, state.x - before[0]):
                        account[AMBIGUOUS] = 1.0
                elif self.body.turning.jumps:
                    yield Jump(ramp, float(progress[PLACE]), int(contact), None, float(distance), float(loss))
                else:
                    raise CommandError(
                        f"command: at {100.0 * place:.4g} % of the ramp no stable equilibrium is left, and the scene "
                        "has on_instability: refuse; jump lets the body move to another one"
                    )
            velocity[:] = 0.0
        state.stability[0] = progress[MARGIN]

    def _explain(self, state: PlanarState, place: float) -> str:
        """Explain why a ramp cannot be followed beyond a place."""
        why = "no equilibrium was found"
        if self.body.turning is not None:
            lengths = self.frame.rest[: self.body.springs]
            for link in np.flatnonzero(state.shape[: self.body.springs] < (COLLAPSED - 1.0) * lengths)[:1]:
                why = f"link_{link} shrinks to a point, for want of a rest length > 0,"
        return f"command: {why} at {100.0 * place:.4g} % of the ramp"

    def _falls(
        self, state: tuple[np.ndarray, ...], target: np.ndarray, part: float, moved: np.ndarray, distance: float
    ) -> bool:
        """Determine whether a body that moved by a distance with a part of a ramp has jumped, or slid on."""
        found, _, nearer, _ = jump(self.frame, state, target, part / _NEARER, moved, np.zeros(ACCOUNT_SIZE))
        return not found or distance < _CONTINUOUS * nearer


@functools.lru_cache
def _columns_of(width: int, first: int, discs: int) -> np.ndarray:
    """List the columns of a target, four times those of the frictions of discs."""
    times = np.ones(width, np.int64)
    times[first : first + discs] = 4
    return np.repeat(np.arange(width), times)


def build_plane_motion(plan: Plan) -> PlaneMotion:
    """Build the motion of a plan; its tolerance is relative to the changes of length that its drive commands.

    Args:
        plan: the body, its drive and its tolerance.

    Returns:
        The motion.
    """
    frame = build_frame(plan.body, plan.directions)
    links, parts = frame.links, frame.rest.size
    change = np.abs(np.ptp(plan.drive.targets[:, :parts], axis=0))
    if frame.vector:
        size = float(change.max(initial=0.0)) or float(np.abs(np.ptp(frame.position, axis=0)).max())
        return PlaneMotion(plan.body, frame, _SHARE * (plan.tolerance or DEFAULT_TOLERANCE) * size)
    change[links:] *= frame.rest[:links].mean()
    size = float(change.max(initial=0.0)) or float(frame.rest[:links].max())
    least = _ROUNDING * float(np.abs(frame.position).max() + frame.rest[:links].sum())
    return PlaneMotion(plan.body, frame, max(_SHARE * (plan.tolerance or TURNING_TOLERANCE) * size, least))
