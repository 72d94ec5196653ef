"""The crawler: its state and its response to commands."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import FLOAT, frozen
from ..body.body import Body
from ..body.curves import energy_of_sliders
from ..body.plan import Plan, check_plan
from ..errors import CommandError
from ..motion.account import ACCOUNT_SIZE, SPENT, empty_account
from ..motion.follow import State, build_motion
from ..notebook import write_html, write_numbers
from .budget import default_budget
from .command import write_command
from .method import Method, choose_method
from .step import Step

_SHOWN = {"net_translation": "m", "displacement": "m", "contact_state": "1", "tension": "N", "margins": "N"}
"""What a notebook shows of a crawler, with units."""


class Crawler:
    """A crawler at one instant: the command in force, the positions of its contacts, the tensions of its links."""

    def __init__(self, scene: Plan, method: Method | None = None, budget: int | None = None) -> None:
        """Create a crawler in the start state of a scene.

        Args:
            scene: body, friction, start, and the command in force at the start.
            method: "exact" follows every event, "catch_up" takes one implicit step per ramp; by default exact on a
                line. In the plane only "catch_up", with steps refined to the scene's tolerance.
            budget: upper limit of work in one ramp of `exact`: contacts solved (at an event the contacts of the sliding
                block that changes; in a graph in every round of its active set) plus breakpoints passed in projections;
                by default 10 000 (N + 1 000). In the plane points in evaluations of steps, by default 200 000 (N +
                100). When it is exceeded, a catch-up step completes the ramp, and `Step.overspent` counts it; for a
                body that turns this is a jump.

        Raises:
            CommandError: if the method is unknown, or is `exact` in the plane, or the budget is no whole number.
            SceneError: if `scene` is not a scene.
        """
        check_plan(scene, "Crawler")
        self.scene = scene
        self.method = choose_method(scene, method)
        self.budget = default_budget(scene.body) if budget is None else budget
        if not isinstance(self.budget, (int, np.integer)) or self.budget < 0:
            raise CommandError(f"budget: {budget!r}; it must be a whole number, 0 or more")
        self._motion = build_motion(scene)
        self._state: State = self._motion.start(scene.start_displacement, scene.drive.targets[0])
        self._row: np.ndarray | None = scene.drive.rows[0]  # as commanded; None if only the target is known
        self._scratch = self._motion.scratch()
        on_line = scene.body.lengths + 2 * scene.body.contacts
        self._widths = (
            {scene.columns.index.size} if scene.body.dimension == 2 else {on_line, on_line + scene.body.contacts}
        )
        """Columns of targets; on a line without loads, and with loads."""
        simple = scene.columns.is_plain and getattr(self._motion, "simple", False)
        self._simple = scene.columns.plain_lengths if simple else None  # shape of usual commands
        self._nothing = np.append(empty_account(), np.zeros(self._state.displacement.size))
        self._no_records = np.empty((0, 2 * self._state.displacement.size + self._state.tension.size))

    @property
    def body(self) -> Body:
        """The body."""
        return self.scene.body

    @property
    def displacement(self) -> np.ndarray:
        """x, shape (N,), in the plane (N, 2) [m]."""
        return frozen(self._state.displacement)

    @property
    def shape(self) -> np.ndarray:
        """z, elongation of each spring relative to the reference shape, shape (S,), in the plane (S, 2) [m]."""
        return frozen(self._state.shape)

    @property
    def tension(self) -> np.ndarray:
        """T, shape (S,), in the plane (S, 2) [N]."""
        return frozen(self._state.tension)

    @property
    def hysteresis(self) -> np.ndarray:
        """Forces of the elements of hysteresis, spring by spring, shape (H,) [N]; empty without any."""
        return frozen(getattr(self._state, "hysteresis", np.empty(0)))

    @property
    def stored(self) -> float:
        """Energy stored in the springs, with their elements of hysteresis [J]."""
        energy = float(self.body.energy(self.tension, self.displacement, self.actuation))
        return energy + energy_of_sliders(self.body.bends, self.hysteresis)

    @property
    def actuation(self) -> np.ndarray:
        """L in force of each spring, shape (S,), in the plane (S, 2) [m]."""
        return frozen(self._state.actuation)

    @property
    def commanded(self) -> np.ndarray:
        """L as commanded, from which `actuation` differs within the backlash of actuators, same shape [m]."""
        return frozen(self._state.commanded)

    def lengths_at(self, targets: np.ndarray) -> np.ndarray:
        """Compute the rest lengths that ramps will lead to, with the backlash of actuators.

        Args:
            targets: rows as returned by `target`, which are not followed here, shape (V, F).

        Returns:
            L of each spring at the end of each ramp, shape (V, S), in the plane (V, 2 S), with joints (V, S + J)
            [m, rad].

        Raises:
            CommandError: if `targets` has another shape.
        """
        targets = self._check_targets(targets)
        backlash, lengths = self.body.backlash, targets[:, : self.body.lengths]
        return lengths if backlash is None else backlash.lead_along(self.actuation[backlash.springs], lengths)

    @property
    def forward(self) -> np.ndarray:
        """mu_plus in force, as commanded on patches of ground, shape (N,) [N]; for bodies on a line."""
        self.scene.columns.check_two_sided("forward")
        return frozen(self._state.friction[: self.body.contacts])

    @property
    def backward(self) -> np.ndarray:
        """mu_minus in force, shape (N,) [N]; for bodies on a line."""
        self.scene.columns.check_two_sided("backward")
        return frozen(self._state.friction[self.body.contacts :])

    @property
    def friction(self) -> np.ndarray:
        """Friction in force, as in a target: forward, then backward; in the plane by contact, shape (F,) [N]."""
        return frozen(self._state.friction)

    @property
    def loads(self) -> np.ndarray:
        """Load on each contact, the slope's share included, shape (N,), in the plane (N, 2); empty if none [N]."""
        return frozen(self._state.loads)

    @property
    def places(self) -> np.ndarray | None:
        """Place of each contact on patches of ground, as in `Track`, shape (N,); None on ground without patches."""
        place = getattr(self._state, "place", None)
        return None if place is None else frozen(place, np.int64)

    @property
    def net_translation(self) -> float | np.ndarray:
        """y, the mean of x over all isolated contacts and segments, equally weighted [m]; in the plane shape (2,)."""
        y = self.body.share @ self._state.displacement
        return frozen(y) if y.ndim else float(y)

    @property
    def contact_state(self) -> np.ndarray:
        """State of each contact in the last command: 1 slid forward, -1 slid backward, 0 stuck; int8, shape (N,).

        In the plane 1 slid, 0 stuck.
        """
        state = self._state.contact_state
        state.flags.writeable = False
        return state

    @property
    def gained(self) -> np.ndarray:
        """Displacement during the last command, shape (N,), in the plane (N, 2) [m]."""
        return frozen(self._state.gained)

    @property
    def yaw(self) -> float:
        """Angle of the heading from the x axis, whole turns counted [rad]; 0 for bodies that do not turn."""
        return float(getattr(self._state, "yaw", 0.0))

    @property
    def stability_margin(self) -> float | None:
        """Least stability margin of the last command [1]; None for bodies that do not turn.

        It is measured where the steps along the command end. Below 0 a small deviation grows along the path, as when a
        contact is pushed.
        """
        return getattr(self._state, "stability_margin", None)

    @property
    def spring_force(self) -> np.ndarray:
        """g, force of the springs on each contact, shape (N,), in the plane (N, 2) [N]."""
        state: Any = self._state
        return frozen(self.body.spring_force(state.tension) if self.body.turning is None else state.force)

    @property
    def margins(self) -> np.ndarray:
        """Distance of each contact's spring force from its nearest bound, shape (N,) [N]."""
        return frozen(self._state.margins(self.spring_force))

    @property
    def visited_margin(self) -> float:
        """How close all contacts are to sliding at once, in the present state [1]."""
        return self._state.visited_margin(self.spring_force)

    @property
    def visited_margin_sampled(self) -> bool:
        """Whether a `Step` samples its visited margin only at the ends of ramps (in the plane, of steps)."""
        return self.method != "exact" or self._motion.samples_margin

    @property
    def joint_elongation(self) -> np.ndarray:
        """Elongation of each link, then of each segment, shape (J,), in the plane (J, 2) [m]."""
        return frozen(self.body.joint_sum(self.shape))

    @property
    def joint_tension(self) -> np.ndarray:
        """Tension of each link, then mean tension of each segment, shape (J,), in the plane (J, 2) [N]."""
        return frozen(self.body.joint_mean(self._state.tension))

    def copy(self) -> Crawler:
        """Copy the crawler.

        Returns:
            An independent crawler in the same state.
        """
        other = object.__new__(Crawler)
        other.__dict__ |= self.__dict__
        other._state = self._state.copy()
        other._scratch = self._motion.scratch()
        return other

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy only the scene and the state: kernels are compiled for read-only arrays, which copies would not be."""
        return Crawler, (self.scene, self.method, self.budget), (self._state, self._row)

    def __setstate__(self, state: tuple[State, np.ndarray | None]) -> None:
        self._state, self._row = state

    def placed(self, displacement: np.ndarray, target: np.ndarray) -> Crawler:
        """Build a crawler at rest at other positions, for example to continue a recorded run.

        Args:
            displacement: x, shape (N,), in the plane (N, 2) [m].
            target: the command in force, as from `target`, shape (S + 2 N,).

        Returns:
            The crawler. It differs by rounding from one that moved to this state.

        Raises:
            CommandError: if `displacement` or `target` has another shape.
        """
        if np.shape(displacement) != self._state.displacement.shape:
            raise CommandError(
                f"displacement: shape {np.shape(displacement)}; {self._state.displacement.shape} is right"
            )
        (target,) = self._check_targets(np.asarray(target)[None])
        other = self.copy()
        other._state, other._row = self._motion.start(displacement, target), None
        return other

    def __eq__(self, other: object) -> bool:
        """Compare scenes, methods, budgets and states bitwise."""
        if not isinstance(other, Crawler):
            return NotImplemented
        settings = (self.scene, self.method, self.budget) == (other.scene, other.method, other.budget)
        return settings and self._state.bits() == other._state.bits()

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        """Describe the crawler in one line."""
        state = write_numbers(self.contact_state)
        return f"Crawler({self.scene.name}, {self.method}, net_translation {self.net_translation} m, {state})"

    def _repr_html_(self) -> str:
        """Describe the crawler in a notebook."""
        lengths = {f"{name} [{unit}]": getattr(self, name) for name, unit in _SHOWN.items()}
        return write_html(f"Crawler {self.scene.name}", [("body", self.body.describe()), *lengths.items()])

    def target(
        self,
        actuation: ArrayLike,
        forward: ArrayLike | None = None,
        backward: ArrayLike | None = None,
        loads: ArrayLike | None = None,
    ) -> np.ndarray:
        """Check a command and convert it to a target for `follow`.

        Args:
            actuation: as for `advance`.
            forward: as for `advance`.
            backward: as for `advance`.
            loads: as for `advance`.

        Returns:
            L of every spring, mu_plus and mu_minus of every contact, shape (S + 2 N,).

        Raises:
            CommandError: if a value is invalid; the message names the first one.
        """
        row = write_command(self.scene, self._row, actuation, forward, backward, loads)
        return np.array(self._target(row))

    def _target(self, row: np.ndarray) -> np.ndarray:
        """Convert a row to a target, perhaps the row itself; what it leaves out stays as it is in force."""
        columns, state = self.scene.columns, self._state
        if self._row is None and np.isnan(row).any():
            target = columns.held_target(row, state.commanded.ravel(), state.bounds, state.loads)
        else:
            target = columns.target(row)
        columns.check_equilibrium(target, "command", CommandError)
        return target

    @property
    def row(self) -> np.ndarray:
        """The command row in force, as in `Columns`, shape (C,)."""
        state = self._state
        if self._row is not None:
            return self._row.copy()
        return self.scene.columns.row(state.commanded.ravel(), state.friction, state.loads)

    def advance(
        self,
        actuation: ArrayLike,
        forward: ArrayLike | None = None,
        backward: ArrayLike | None = None,
        loads: ArrayLike | None = None,
    ) -> Step:
        """Ramp in a straight line from the command in force to a new one.

        Args:
            actuation: L of each link [m], then strain of each segment [1], shape (links + segments,); in the plane
                shape (links, 2), for a body that turns of each link, then of each joint [rad], shape (links + joints,).
            forward: mu_plus of each isolated contact [N], then of each segment [N/m]; None leaves it unchanged. In
                the plane the friction of each contact, for a body that turns forward, backward, left and right of each.
            backward: mu_minus, of the same shape; not in the plane.
            loads: f of each isolated contact [N], then of each segment [N/m], towards +x positive, in the plane shape
                (N, 2); None leaves it unchanged. Only for scenes with loads.

        Returns:
            The account of the ramp.

        Raises:
            CommandError: if the command is invalid; the state does not change.
        """
        if forward is None and backward is None and loads is None:
            step = self._advance_lengths(actuation)
            if step is not None:
                return step
        row = write_command(self.scene, self._row, actuation, forward, backward, loads)
        known = self._row is not None or not np.isnan(row).any()
        step = self.follow(self._target(row)[None])
        self._row = row if known else None
        return step

    def _advance_lengths(self, actuation: ArrayLike) -> Step | None:
        """Follow a usual command in one compiled call, which checks it; None if it needs a closer look."""
        if self._simple is None or self._row is None:
            return None
        try:
            lengths = np.asarray(actuation)
        except ValueError:
            return None
        if lengths.shape != self._simple or lengths.dtype is not FLOAT:
            return None
        row, account = self._row.copy(), self._nothing.copy()
        row[: lengths.size] = lengths
        motion: Any = self._motion
        if not motion.advance(self._state, self._scratch, row[None], self.method == "exact", self.budget, account):
            return None
        self._row = row
        account.setflags(write=False)
        return Step(account[ACCOUNT_SIZE:], account[:ACCOUNT_SIZE], self.scene.body.share)

    def follow(self, targets: np.ndarray, records: np.ndarray | None = None, before: Step | None = None) -> Step:
        """Ramp to several checked commands in turn.

        Args:
            targets: rows as returned by `target`, shape (V, S + 2 N).
            records: output after each ramp, shape (V, 2 N + S) or (V, 2 N + S + SPENT), see `Motion.follow`.
            before: an account to continue; its velocity and translation interval are not continued.

        Returns:
            The account of all ramps together.

        Raises:
            CommandError: if `targets` or `records` has another shape, or nothing holds the body on the ground that it
                reaches, or a part of it behind slack springs; the state does not change.
        """
        targets = self._check_targets(targets)
        if records is not None:
            self._check_records(records, targets.shape[0])
        account = empty_account() if before is None else before.account.copy()
        jumps = self._motion.follow(
            self._state,
            self._scratch,
            targets,
            self.method == "exact",
            self.budget,
            account,
            self._no_records if records is None else records,
        )
        self._row = None if targets.shape[0] else self._row
        velocity = self._state.gained.copy()
        velocity.setflags(write=False)
        account.setflags(write=False)
        return Step(velocity, account, self.scene.body.share, jumps or ())

    def _check_targets(self, targets: np.ndarray) -> np.ndarray:
        """Return the targets in the one type of array that kernels take; these check no index."""
        if np.ndim(targets) != 2 or targets.shape[1] not in self._widths:
            count = self.scene.columns.index.size
            raise CommandError(f"targets: shape {np.shape(targets)}; (V, {count}) is right, with rows from `target`")
        if targets.dtype is not FLOAT or not targets.flags.carray:
            return np.array(targets, dtype=np.float64, order="C")
        return targets

    def _check_records(self, records: np.ndarray, count: int) -> None:
        """Refuse records into which kernels, which check no index, would write beyond the end."""
        width = self._no_records.shape[1]
        if records.dtype != FLOAT or records.shape not in {(count, width), (count, width + SPENT)}:
            raise CommandError(
                f"records: {records.dtype}, shape {records.shape}; float64, shape ({count}, {width}) or "
                f"({count}, {width + SPENT}) is right"
            )


def prepare(scene: Plan) -> None:
    """Load the kernels for a scene, or compile them when they are first used on this machine.

    Args:
        scene: the scene.
    """
    Crawler(scene).follow(scene.drive.targets[:1])  # the command in force: nothing moves
