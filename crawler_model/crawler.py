"""The crawler: its state, and how it answers a command."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from . import integrate
from ._compiled import said_if_slow
from .body import Body, frozen
from .errors import LARGEST, CommandError
from .integrate import (
    ACTUATION,
    ACTUATION_REF,
    AMBIGUOUS,
    AT_BACKWARD,
    AT_FORWARD,
    BACKWARD,
    COMPLEMENTARITY,
    DISSIPATION,
    EVENTS,
    FORWARD,
    GAIN_LEAST,
    GAIN_MOST,
    GAINED,
    OVERSPENT,
    RESIDUAL,
    SHAPE,
    TENSION,
    TENSION_REF,
    VIOLATION,
    VISITED,
    WORK,
    X,
)
from .scene import Scene
from .stasis import rounding_of_forces, spring_force, stasis_margins
from .uniqueness import visited_margin

Method = Literal["exact", "catch_up"]
METHODS: tuple[Method, ...] = ("exact", "catch_up")


@dataclass(frozen=True)
class Certificate:
    """Three numbers that certify a ramp; all are rounding for `exact`, and the error of `catch_up`.

    Attributes:
        energy_residual: dE + dissipation - work [J].
        violation: largest excess of a spring force over its bound [N].
        complementarity: largest |dx_i| times the distance of g_i from the bound it should be at [J].
    """

    energy_residual: float
    violation: float
    complementarity: float


@dataclass(frozen=True, eq=False)
class Step:
    """What happened on the way to a command.

    Attributes:
        events: linear pieces of the solution.
        work: work of the actuators [J].
        dissipation: energy lost to friction [J].
        velocity: displacement gained, per ramp, shape (N,) [m].
        unique: False when on some stretch the translation was not determined.
        translation_interval: least and greatest net translation that the ramp could have gained [m].
        certificate: how well the answer solves the model.
        visited_margin: how near all contacts came to sliding at once.
        overspent: ramps in which the budget of events was spent and a catch-up step did the rest.
    """

    events: int
    work: float
    dissipation: float
    velocity: np.ndarray
    unique: bool
    translation_interval: tuple[float, float]
    certificate: Certificate
    visited_margin: float
    overspent: int


class Crawler:
    """A crawler at one instant: what is commanded, where its contacts stand, the tension of its links."""

    def __init__(self, scene: Scene, method: Method = "exact", budget: int | None = None) -> None:
        """Put the crawler at the scene's start.

        Args:
            scene: body, friction, start, and the command in force at the start.
            method: "exact" follows every event, "catch_up" takes one implicit step a ramp.
            budget: most linear pieces of one ramp; by default 1000 + 100 N.

        Raises:
            CommandError: when the method is another.
        """
        if method not in METHODS:
            raise CommandError(f"method: {method!r}; it must be one of {', '.join(METHODS)}")
        self.scene = scene
        self.method = method
        body, drive, x = scene.chain, scene.commands, scene.start_displacement
        n = body.contacts
        self.budget = 1000 + 100 * n if budget is None else budget
        state = np.zeros((integrate.STATE_ROWS, n))
        state[X] = x
        state[ACTUATION, :-1] = state[ACTUATION_REF, :-1] = drive.actuation[0]
        state[FORWARD], state[BACKWARD] = drive.forward[0], drive.backward[0]
        state[SHAPE, :-1] = np.diff(x)
        tension = body.stiffness * (state[SHAPE, :-1] - drive.actuation[0])
        state[TENSION, :-1] = state[TENSION_REF, :-1] = tension
        self._state = state
        self._status = _status_at_rest(tension, state[FORWARD], state[BACKWARD])
        self._stiffness = body.stiffness
        self._no_records = np.empty((0, 3, n))
        self._scratch = integrate.scratch(n)

    @property
    def body(self) -> Body:
        """The body."""
        return self.scene.chain

    @property
    def displacement(self) -> np.ndarray:
        """x, shape (N,) [m]."""
        return frozen(self._state[X])

    @property
    def shape(self) -> np.ndarray:
        """z, elongation of each link against the reference shape, shape (N - 1,) [m]."""
        return frozen(self._state[SHAPE, :-1])

    @property
    def tension(self) -> np.ndarray:
        """T, shape (N - 1,) [N]."""
        return frozen(self._state[TENSION, :-1])

    @property
    def actuation(self) -> np.ndarray:
        """L in force, shape (N - 1,) [m]."""
        return frozen(self._state[ACTUATION, :-1])

    @property
    def forward(self) -> np.ndarray:
        """mu_plus in force, shape (N,) [N]."""
        return frozen(self._state[FORWARD])

    @property
    def backward(self) -> np.ndarray:
        """mu_minus in force, shape (N,) [N]."""
        return frozen(self._state[BACKWARD])

    @property
    def net_translation(self) -> float:
        """y, the mean of x over the contacts [m]."""
        return float(self._state[X].sum()) / self._state.shape[1]

    @property
    def contact_state(self) -> np.ndarray:
        """What each contact did on the last command: 1 slid forward, -1 slid backward, 0 stuck; int8, shape (N,)."""
        state = np.sign(self._state[GAINED]).astype(np.int8)
        state.flags.writeable = False
        return state

    @property
    def margins(self) -> np.ndarray:
        """Distance of each contact's spring force from its nearest bound, shape (N,) [N]."""
        return stasis_margins(self._state[TENSION, :-1], self._state[FORWARD], self._state[BACKWARD])

    @property
    def visited_margin(self) -> float:
        """How near all contacts are to sliding at once, now."""
        return visited_margin(spring_force(self._state[TENSION, :-1]), self._state[FORWARD], self._state[BACKWARD])

    def copy(self) -> Crawler:
        """Fork the state.

        Returns:
            A crawler that goes its own way from here.
        """
        other = copy.copy(self)
        other._state = self._state.copy()
        other._status = self._status.copy()
        other._scratch = integrate.scratch(self.body.contacts)
        return other

    def __eq__(self, other: object) -> bool:
        """Compare scenes and states, bit for bit."""
        if not isinstance(other, Crawler):
            return NotImplemented
        return (
            self.scene == other.scene
            and self._state.tobytes() == other._state.tobytes()
            and self._status.tobytes() == other._status.tobytes()
        )

    __hash__ = None  # type: ignore[assignment]

    def target(
        self, actuation: ArrayLike, forward: ArrayLike | None = None, backward: ArrayLike | None = None
    ) -> np.ndarray:
        """Check a command and lay it out for `follow`.

        Args:
            actuation: L, shape (N - 1,) [m].
            forward: mu_plus, shape (N,), >= 0 [N]; None keeps what is in force.
            backward: mu_minus, likewise.

        Returns:
            Rows of L (its last entry 0), mu_plus and mu_minus, shape (3, N).

        Raises:
            CommandError: naming the first value that cannot be followed.
        """
        n = self.body.contacts
        target = np.zeros((3, n))
        target[1], target[2] = self._state[FORWARD], self._state[BACKWARD]
        given = (("actuation", actuation, n - 1), ("forward", forward, n), ("backward", backward, n))
        for row, (name, values, size) in enumerate(given):
            if values is None and row > 0:
                continue
            try:
                array = np.asarray(values, dtype=np.float64)
            except (TypeError, ValueError):
                raise CommandError(f"{name}: {values!r}; it must be {size} numbers") from None
            if array.shape != (size,):
                raise CommandError(f"{name}: shape {array.shape}; it must be ({size},)")
            if not np.isfinite(array).all():
                i = int(np.flatnonzero(~np.isfinite(array))[0])
                raise CommandError(f"{name}: entry {i} is {array[i]}; it must be finite")
            if np.abs(array).max() > LARGEST:
                i = int(np.abs(array).argmax())
                raise CommandError(f"{name}: entry {i} is {array[i]:g}; it must be at most {LARGEST:g} in size")
            if row > 0 and not (array >= 0.0).all():
                i = int(np.flatnonzero(array < 0.0)[0])
                raise CommandError(f"{name}: contact {i} has {array[i]:g} N; friction must be >= 0")
            target[row, :size] = array
        return target

    def advance(
        self, actuation: ArrayLike, forward: ArrayLike | None = None, backward: ArrayLike | None = None
    ) -> Step:
        """Ramp in a straight line from the command in force to a new one.

        Args:
            actuation: L, shape (N - 1,) [m].
            forward: mu_plus, shape (N,), >= 0 [N]; None keeps what is in force.
            backward: mu_minus, likewise.

        Returns:
            What happened on the way.

        Raises:
            CommandError: when the command cannot be followed; the state is untouched.
        """
        return self.follow(self.target(actuation, forward, backward)[None])

    def follow(self, targets: np.ndarray, records: np.ndarray | None = None) -> Step:
        """Ramp to several checked commands in turn.

        Args:
            targets: rows as from `target`, shape (V, 3, N).
            records: memory for displacement, its rounding rest and tension after each ramp, shape (V, 3, N).

        Returns:
            What happened on the way, all ramps together.
        """
        account = np.zeros(integrate.ACCOUNT_SIZE)
        account[VISITED] = np.inf
        integrate.follow(
            self._stiffness,
            self._state,
            self._status,
            targets,
            self.method == "exact",
            self.budget,
            *self._scratch,
            account,
            self._no_records if records is None else records,
        )
        velocity = self._state[GAINED].copy()
        velocity.flags.writeable = False
        gain = float(velocity.sum()) / velocity.size
        if account[VISITED] == np.inf:  # nothing but holding
            account[VISITED] = self.visited_margin
        return Step(
            events=int(account[EVENTS]),
            work=float(account[WORK]),
            dissipation=float(account[DISSIPATION]),
            velocity=velocity,
            unique=bool(account[AMBIGUOUS] == 0.0),
            translation_interval=(gain + float(account[GAIN_LEAST]), gain + float(account[GAIN_MOST])),
            certificate=Certificate(
                float(account[RESIDUAL]), float(account[VIOLATION]), float(account[COMPLEMENTARITY])
            ),
            visited_margin=float(account[VISITED]),
            overspent=int(account[OVERSPENT]),
        )


def _status_at_rest(tension: np.ndarray, forward: np.ndarray, backward: np.ndarray) -> np.ndarray:
    """Find the bounds that contacts are at, but for rounding; both only where there is no friction."""
    g = spring_force(tension)
    near = rounding_of_forces(tension, forward + backward)
    above, below = forward - g, g + backward
    none = forward + backward == 0.0
    at_forward = none | ((above <= near) & (above <= below))
    at_backward = none | ((below <= near) & (below < above))
    return (AT_FORWARD * at_forward + AT_BACKWARD * at_backward).astype(np.int8)


def prepare() -> None:
    """Load the compiled kernels, or compile them on their first use on this machine and say so on standard error."""
    body = {"contacts": [0.0, 1.0], "links": {"stiffness": 1.0}}
    scene = Scene.model_validate({"name": "prepare", "body": body, "friction": {"isotropic": 1.0}})
    with said_if_slow():
        Crawler(scene).advance([0.5])
