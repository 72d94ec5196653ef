"""Ground that changes along the track: borders that contacts reach, stand on, cross, or jump over.

Inside a region between two borders a contact has the bounds of that region. On a border its forward bound is that of
the ground ahead, its backward bound that of the ground behind. A sliding contact that reaches a border is an event:

* The bound beyond is harder: the contact stops there until its spring force reaches the new bound.
* The bound beyond is softer: no equilibrium is left at this place, and the contact jumps at fixed commands. Spring
  forces are monotone (the stiffness matrix has no positive off-diagonal entries), so all contacts move one way, and the
  end is the least displacement at which all bounds hold again. The exact motion finds it, as a ramp on which the bound
  goes from the old to the new value. A border met on the way is a further event.

A jump loses energy: what the bound was above its new value, times the displacement of the contact.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

import numpy as np

from ..body.body import Body
from ..body.ground import Ground
from .line_state import LineState
from .state import (
    ACCOUNT_SIZE,
    ACTUATION,
    AT_BACKWARD,
    AT_FORWARD,
    BACKWARD,
    DISSIPATION,
    FORWARD,
    GAINED,
    JUMP_LOSS,
    JUMPS,
    LOAD,
    OVERSPENT,
    TENSION,
    VISITED,
    X_REST,
    X,
    add_ramp,
)

_SAME = 4.0 * float(np.finfo(np.float64).eps)
"""Bounds that differ by less than this part of them are the same on both sides of a border."""


@dataclass(frozen=True)
class Jump:
    """A contact that lost its equilibrium on a border.

    Attributes:
        ramp: the ramp on which it happened, counted from 0 since `follow` was called.
        part: the place on that ramp, 0 .. 1 [1].
        contact: the contact.
        border: the place on the track [m].
        distance: how far the contact jumped [m].
        loss: energy lost beside friction, further jumps on the way included [J].
    """

    ramp: int
    part: float
    contact: int
    border: float
    distance: float
    loss: float


class BorderMotion(Protocol):
    """A motion that can stop where a contact reaches a border."""

    @property
    def body(self) -> Body: ...  # noqa: D102
    def start(self, x: np.ndarray, target: np.ndarray) -> LineState:
        """Build the state at rest, see `Motion`."""
        ...

    def scratch(self) -> Any:
        """Allocate the memory of a ramp, see `Motion`."""
        ...

    def follow_to_border(
        self, state: LineState, scratch: Any, target: np.ndarray, budget: int, account: np.ndarray, borders: np.ndarray
    ) -> tuple[float, int]:
        """Follow one ramp up to its end, or to where a contact reaches a border; the part of it, and the contact."""
        ...


@dataclass(eq=False)
class PatchedState(LineState):
    """The state of a body on patches: what is commanded, and the ground under each contact.

    Attributes:
        command: L, mu_plus, mu_minus and load in force, off the patches, shape (S + 3 N,).
        ahead: the region that the forward bound of each contact is of, shape (N,).
        behind: the region that its backward bound is of, shape (N,); other than `ahead` on a border.
        jumps: since `follow` was last called.
    """

    command: np.ndarray = field(default_factory=lambda: np.zeros(0))
    ahead: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    behind: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    jumps: list[Jump] = field(default_factory=list)

    @property
    def friction(self) -> np.ndarray:
        """Friction in force as in a target without loads, off the patches, shape (2 N,) [N]."""
        n = self.ahead.size
        return self.command[-3 * n : -n].copy()

    def copy(self) -> PatchedState:
        """Fork the state.

        Returns:
            Another state of the same numbers, in arrays of its own.
        """
        arrays = (self.contacts, self.links, self.status, self.command, self.ahead, self.behind)
        return PatchedState(*(a.copy() for a in arrays), list(self.jumps))

    def bits(self) -> bytes:
        """Lay all numbers out for comparison.

        Returns:
            The bytes of all arrays, one after another.
        """
        return super().bits() + b"".join(a.tobytes() for a in (self.command, self.ahead, self.behind))


@dataclass(frozen=True, eq=False)
class PatchedMotion:
    """A body on a line on ground that changes along the track.

    Attributes:
        inner: the motion of the body on the same ground everywhere.
        ground: the ground.
    """

    methods: ClassVar[tuple[str, ...]] = ("exact",)
    inner: BorderMotion
    ground: Ground

    def start(self, x: np.ndarray, target: np.ndarray) -> PatchedState:
        """Build the state at rest, see `Motion`."""
        border, position = self.ground.border, self.inner.body.position + x
        ahead, behind = (np.searchsorted(border, position, side=side) for side in ("right", "left"))
        command = self._commanded(target)
        line = self.inner.start(x, self._target(command, ahead, behind, np.zeros(x.size)))
        return PatchedState(line.contacts, line.links, line.status, command, ahead, behind)

    def scratch(self) -> Any:
        """Allocate the memory of a ramp, see `Motion`."""
        return self.inner.scratch()

    def follow(
        self,
        state: PatchedState,
        scratch: Any,
        targets: np.ndarray,
        exact: bool,
        budget: int,
        account: np.ndarray,
        records: np.ndarray,
    ) -> None:
        """Follow straight ramps to each of the targets in turn, see `Motion`; always exact."""
        ramps = _Ramps(self, state, scratch, budget, account)
        for number, target in enumerate(targets):
            ramps.number = number
            ramps.follow(self._commanded(target))
            if records.shape[0]:
                records[number] = np.concatenate((state.contacts[X], state.contacts[X_REST], state.links[TENSION]))
        state.contacts[GAINED] = ramps.gained
        if account[VISITED] == np.inf:  # nothing but holding
            account[VISITED] = state.visited_margin(self.inner.body.spring_force(state.tension))

    def _commanded(self, target: np.ndarray) -> np.ndarray:
        """Read mu_plus and mu_minus from the bounds and the loads of a target."""
        n = self.inner.body.contacts
        command = target.copy()
        forward, backward, load = command[-3 * n :].reshape(3, n)
        forward += load
        backward -= load
        return command

    def _target(self, command: np.ndarray, ahead: np.ndarray, behind: np.ndarray, extra: np.ndarray) -> np.ndarray:
        """Lay out the bounds of contacts in their regions, with extra loads, as the inner motion follows them."""
        n, ground = ahead.size, self.ground
        target = command.copy()
        forward, backward, load = target[-3 * n :].reshape(3, n)
        forward *= ground.forward[ahead]
        backward *= ground.backward[behind]
        forward -= load + ground.weight * ground.pull[ahead] + extra
        backward += load + ground.weight * ground.pull[behind] + extra
        load += ground.weight * ground.pull[ahead]
        return target


class _Ramps:
    """Ramps followed from border to border."""

    def __init__(
        self, motion: PatchedMotion, state: PatchedState, scratch: Any, budget: int, account: np.ndarray
    ) -> None:
        self.motion, self.state, self.scratch, self.budget, self.account = motion, state, scratch, budget, account
        self.extra = np.zeros(state.ahead.size)
        self.gained = np.zeros(state.ahead.size)
        self.number = 0
        self.part = 0.0

    def follow(self, command: np.ndarray) -> None:
        """Follow a ramp of the commands."""
        self.part = 0.0
        self._ramp(command, self.extra, timed=True)

    def _ramp(self, command: np.ndarray, extra: np.ndarray, timed: bool) -> float:
        """Follow a ramp of commands and extra loads to its end; return the energy lost on it beside friction."""
        lost = 0.0
        while True:
            part, contact, of_this = self._go(command, extra)
            lost += of_this
            self.part += part * (1.0 - self.part) * timed
            if contact < 0:
                return lost
            lost += self._meet(contact)

    def _go(self, command: np.ndarray, extra: np.ndarray) -> tuple[float, int, float]:
        """Go on to the end of a ramp or to the next border."""
        state, motion = self.state, self.motion
        n = state.ahead.size
        ramp = np.zeros(ACCOUNT_SIZE)
        ramp[VISITED] = np.inf
        target = motion._target(command, state.ahead, state.behind, extra)
        part, contact = motion.inner.follow_to_border(
            state, self.scratch, target, self.budget, ramp, self._borders()
        )
        moved = state.contacts[GAINED]
        lost = 0.0
        if self.extra.any():
            mean = self.extra + 0.5 * part * (extra - self.extra)
            lost = self._loss(ramp, mean, moved)
        add_ramp(self.account, ramp)
        self.account[JUMP_LOSS] += lost
        self.gained += moved
        if part == 1.0:
            state.command[:], self.extra = command, extra
        else:
            state.command += part * (command - state.command)
            self.extra = self.extra + part * (extra - self.extra)
        if ramp[OVERSPENT]:
            self._look_where_contacts_stand()
        del n
        return part, contact, lost
