"""The motion of any body on a line."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ...body.backlash import Backlash
from ...body.body import Body
from ...body.couplings import add_friction
from ...body.ground import Track
from ...compiled import compiled
from ...errors import CommandError
from ..account import WORK, dissipated
from ..jump import Jump
from ..margin import visited_margin
from ..pieces import CHANGE, NO_PIECES, locate_parts
from . import build_records
from .follow import follow
from .ground.borders import ROUNDING
from .records import BACKWARD, CONTACT_STATE, FOOT_STATE, FORWARD, JUMP, RAMP, SPRING_STATE, copy_records, zeros
from .springs.records import SLIDER_STATE

_NO_RECORDS = np.empty((0, 0))


class Scratch(NamedTuple):
    """The working memory of ramps.

    Attributes:
        ramps: RAMP, shape (1,).
        memory: the fields of a `Model`.
        budget: its field, shape (1,); to look a field up takes as long as a short ramp.
        exact: likewise.
        falls: the fields of a `Terrain` that falls need; none on ground that is the same everywhere.
        couplings: the fields of `Couplings`; None without any.
    """

    ramps: np.ndarray
    memory: tuple[Any, ...]
    budget: np.ndarray
    exact: np.ndarray
    falls: tuple[np.ndarray, ...]
    couplings: tuple[np.ndarray, ...] | None


@dataclass(eq=False)
class LineState:
    """The state of a body on a line.

    Attributes:
        contacts: CONTACT, shape (N,).
        springs: SPRING, shape (S,).
        sliders: SLIDER, shape (H,); none without springs with hysteresis.
        loaded: whether the body has loads.
        feet: FOOT, shape (N,); None without patches of ground.
        led: the commanded lengths of actuators with backlash, as in `Backlash`, shape (B,) [m]; None without any.
        backlash: the backlash of these; None without any.
    """

    contacts: np.ndarray
    springs: np.ndarray
    sliders: np.ndarray
    loaded: bool = False
    feet: np.ndarray | None = None
    led: np.ndarray | None = None
    backlash: Backlash | None = None

    @property
    def _held(self) -> np.ndarray:
        """What holds the bounds and loads that are commanded, before the ground changes them."""
        return self.contacts if self.feet is None else self.feet

    @property
    def displacement(self) -> np.ndarray:
        """Displacement x, shape (N,) [m]."""
        return self.contacts["x"].copy()

    @property
    def gained(self) -> np.ndarray:
        """Displacement gained in the last command, shape (N,) [m]; a view."""
        return self.contacts["gained"]

    @property
    def shape(self) -> np.ndarray:
        """Elongations z, shape (S,) [m]."""
        return self.springs["elongation"].copy()

    @property
    def tension(self) -> np.ndarray:
        """Tensions T, shape (S,) [N]."""
        return self.springs["tension"].copy()

    @property
    def hysteresis(self) -> np.ndarray:
        """Forces of the elements of hysteresis, spring by spring, shape (H,) [N]."""
        s = self.sliders
        way = self.springs["elongation"][s["spring"]] - s["slip"]
        return np.where(s["mode"] == 0, s["stiffness"] * way, s["mode"] * s["limit"])

    @property
    def actuation(self) -> np.ndarray:
        """Rest-length changes L in force, shape (S,) [m]."""
        return self.springs["length"].copy()

    @property
    def commanded(self) -> np.ndarray:
        """Those commanded, from which L differs within the backlash of actuators, shape (S,) [m]."""
        lengths = self.actuation
        if self.backlash is not None:
            lengths[self.backlash.springs] = self.led
        return lengths

    @property
    def friction(self) -> np.ndarray:
        """Friction in force, forward then backward, shape (2 N,) [N]."""
        c = self._held
        return np.concatenate((c["forward"] + c["load"], c["backward"] - c["load"]))

    @property
    def bounds(self) -> np.ndarray:
        """Bounds of the spring forces as in a target: friction shifted by the loads, shape (2 N,) [N]."""
        return np.concatenate((self._held["forward"], self._held["backward"]))

    @property
    def loads(self) -> np.ndarray:
        """Loads in force, the slope's share included, shape (N,) [N]; shape (0,) without loads."""
        return self._held["load"].copy() if self.loaded else np.empty(0)

    @property
    def contact_state(self) -> np.ndarray:
        """1 if a contact slid forward in the last command, -1 backward, 0 stuck; int8, shape (N,)."""
        return np.sign(self.contacts["gained"]).astype(np.int8)

    @property
    def place(self) -> np.ndarray | None:
        """Place of each contact on patches of ground, as in `Track`, shape (N,); None without patches."""
        return None if self.feet is None else self.feet["place"].copy()

    def margins(self, force: np.ndarray) -> np.ndarray:
        """Compute the distance of the spring forces from their nearest bounds, see `State`; a wall holds any force."""
        ahead, behind = self.contacts["forward"] - force, force + self.contacts["backward"]
        if self.feet is not None:
            ahead[self.feet["walled"] & FORWARD != 0] = np.inf
            behind[self.feet["walled"] & BACKWARD != 0] = np.inf
        return np.minimum(ahead, behind)

    def visited_margin(self, force: np.ndarray) -> float:
        """Compute how close all contacts are to sliding at once [1], see `State`."""
        if self.feet is not None and self.feet["walled"].any():
            friction = float((self.contacts["forward"] + self.contacts["backward"]).sum())
            near = float(np.maximum(self.margins(force), 0.0).sum())
            return min(near / friction, 1.0) if friction > 0.0 else 0.0
        return visited_margin(force, self.contacts["forward"], self.contacts["backward"])

    def copy(self) -> LineState:
        """Copy the state, see `State`."""
        feet = None if self.feet is None else copy_records(self.feet)
        led = None if self.led is None else self.led.copy()
        contacts, springs, sliders = (copy_records(each) for each in (self.contacts, self.springs, self.sliders))
        return LineState(contacts, springs, sliders, self.loaded, feet, led, self.backlash)

    def restore(self, kept: LineState) -> None:
        """Return to former numbers.

        Args:
            kept: a copy of the state.
        """
        self.contacts[:], self.springs[:], self.sliders[:] = kept.contacts, kept.springs, kept.sliders
        if self.feet is not None:
            self.feet[:] = kept.feet
        if self.led is not None:
            self.led[:] = kept.led

    def bits(self) -> bytes:
        """Return all numbers that last from ramp to ramp as bytes, see `State`."""
        parts = [self.contacts[name] for name, _ in CONTACT_STATE] + [self.springs[name] for name in SPRING_STATE]
        if self.feet is not None:
            parts += [self.feet[name] for name in FOOT_STATE]
        parts += [self.sliders[name] for name in SLIDER_STATE]
        if self.led is not None:
            parts.append(self.led)
        return b"".join(part.tobytes() for part in parts)


@dataclass(frozen=True, eq=False)
class LineMotion:
    """A chain or any other graph of springs on a line, followed from event to event or by implicit steps.

    Attributes:
        body: the body.
        track: patches of ground, a profile and walls; None if the ground is the same everywhere.
    """

    body: Body
    track: Track | None = None

    @property
    def methods(self) -> tuple[str, ...]:
        """Names of the methods."""
        return ("exact", "catch_up") if self.track is None or not self.track.leaps else ("exact",)

    @property
    def simple(self) -> bool:
        """Whether every ramp can be followed in one call: actuators without backlash, and nothing runs away."""
        return self.track is None and self.body.backlash is None and not self.body.has_flat_springs

    @property
    def samples_margin(self) -> bool:
        """Whether an exact ramp samples its visited margin only at its ends, as in large bodies."""
        return self.body.contacts > build_records.FEW_CONTACTS

    def start(self, x: np.ndarray, target: np.ndarray) -> LineState:
        """Build the state at rest, see `Motion`; a contact within rounding of a border stands on it."""
        commanded, backlash = target[..., : self.body.springs], self.body.backlash
        springs = build_records.build_springs(self.body, x, self.body.start_lengths(commanded))
        bounds = target[..., self.body.springs :]
        loaded, feet = bounds.shape[-1] > 2 * self.body.contacts, None
        if self.track is not None:
            place = self.track.find_places(self.body.position, x)
            feet = build_records.build_feet(self.body, self.track, x, place, bounds)
            bounds = np.concatenate(self.track.local_bounds(bounds, self.body.position, x))
        contacts = build_records.build_contacts(self.body, x, springs["tension"], bounds)
        if feet is not None:
            contacts["bounds_met"] &= ~feet["walled"]
        sliders = build_records.build_sliders(self.body, springs["elongation"])
        led = None if backlash is None else commanded[..., backlash.springs].copy()
        return LineState(contacts, springs, sliders, loaded, feet, led, backlash)

    def scratch(self) -> Scratch:
        """Allocate the working memory of a ramp, see `Motion`."""
        ramps = zeros(1, RAMP)
        ramps["search"]["leaf_size"], ramps["search"]["shortest"] = (
            build_records.LEAF_SIZE,
            build_records.SHORTEST_BLOCK,
        )
        ramps["search"]["projects_after"], ramps["search"]["patience"] = (
            build_records.PROJECTS_AFTER,
            build_records.PATIENCE,
        )
        ramps["few"], ramps["together"], ramps["turns"] = (
            build_records.FEW_CONTACTS,
            build_records.TOGETHER,
            build_records.TURNS,
        )
        couplings = build_records.build_couplings(self.body, self.track)
        ramps["search"]["chain"] = self.body.is_chain and couplings is None
        memory = build_records.build_memory(self.body, self.track)
        falls = () if self.track is None else build_records.build_falls(self.body, self.track)
        return Scratch(ramps, memory, ramps["budget"], ramps["exact"], falls, couplings)

    def memory_for(self, state: LineState, scratch: Scratch) -> tuple[Any, ...]:
        """Find the fields of a `Model` for a state: the memory's fields, and the sliders of the state.

        Args:
            state: the state, on ground without patches.
            scratch: memory from `scratch`.

        Returns:
            The fields.
        """
        parts = scratch.memory
        return parts if parts[8] is None else (*parts[:8], (*parts[8][:4], state.sliders))

    def follow(
        self,
        state: LineState,
        scratch: Scratch,
        targets: np.ndarray,
        exact: bool,
        budget: int,
        account: np.ndarray,
        records: np.ndarray,
        pieces: np.ndarray = NO_PIECES,
    ) -> tuple[Jump, ...]:
        """Follow straight ramps to each of the targets in turn, see `Motion`.

        Ramps whose commands actuators follow within their backlash are divided where these begin to move.
        """
        backlash = state.backlash
        if backlash is None or not targets.shape[0]:
            return self._follow(state, scratch, targets, exact, budget, account, records, pieces)
        before = np.concatenate((state.commanded, state.bounds, state.loads))
        rows, ramp, end = backlash.divide(state.actuation[backlash.springs], before, targets)
        noted = np.empty((rows.shape[0] if records.shape[0] else 0, records.shape[1]))
        jumps = self._follow(state, scratch, rows, exact, budget, account, noted, pieces)
        state.led = targets[-1, backlash.springs].copy()
        last = np.append(np.flatnonzero(np.diff(ramp)), ramp.size - 1)
        if records.shape[0]:
            records[:] = noted[last]
        begin = np.append(0.0, end[:-1]) * np.append(False, np.diff(ramp) == 0)
        locate_parts(pieces, ramp, begin, end)
        return tuple(
            replace(jump, ramp=int(ramp[k]), fraction=float(begin[k] + jump.fraction * (end[k] - begin[k])))
            for jump in jumps
            for k in (jump.ramp,)
        )

    def advance(
        self, state: LineState, scratch: Scratch, target: np.ndarray, exact: bool, budget: int, account: np.ndarray
    ) -> bool:
        """Follow a ramp to a target whose lengths nobody has checked, of a body that is `simple`.

        Args:
            state: changed in place.
            scratch: memory from `scratch`.
            target: as for `follow`, shape (1, F).
            exact: as for `follow`.
            budget: as for `follow`.
            account: the account and, output, the displacement gained, shape (15 + N,).

        Returns:
            False if a length is not finite or too large; then nothing has changed.
        """
        scratch.budget[0], scratch.exact[0] = budget, exact
        memory = self.memory_for(state, scratch)
        return not follow(state.contacts, state.springs, scratch.ramps, memory, target, account, _NO_RECORDS)

    def _follow(
        self,
        state: LineState,
        scratch: Scratch,
        targets: np.ndarray,
        exact: bool,
        budget: int,
        account: np.ndarray,
        records: np.ndarray,
        pieces: np.ndarray,
    ) -> tuple[Jump, ...]:
        """Follow straight ramps to each of the targets in turn, at which actuators have the lengths given there."""
        ramps, parts = scratch.ramps, self.memory_for(state, scratch)
        scratch.budget[0], scratch.exact[0] = budget, exact
        targets = np.ascontiguousarray(targets)  # in another order they would be compiled for again
        memory, track, room = parts, self.track, 0
        if pieces is not NO_PIECES:
            clusters = (
                parts[7] if pieces.shape[1] <= CHANGE else None
            )  # the velocities of sleeping contacts are not known
            memory = (*parts[:5], pieces, None, clusters, parts[8])
        kept = (state.copy(), account.copy()) if track is not None or self.body.has_flat_springs else None
        while True:
            if track is not None:
                room = room or self.body.contacts + 16
                jumps = zeros(room, JUMP)
                places = track.borders, track.grip, track.pressed, track.rise
                ground = state.feet, jumps, *scratch.falls, *places, track.profile, scratch.couplings
                memory = (*parts[:6], ground, None, parts[8])
            runaway = follow(state.contacts, state.springs, ramps, memory, targets, account, records)
            if kept is None or (track is None and not runaway):
                return ()
            count = int(ramps["fall"]["jumps"][0])
            if not runaway and count <= room:
                rows = jumps[["ramp", "fraction", "contact", "border", "distance", "loss"]][:count]
                # at a knot where no rates exist with the piece that is left, a jump leads to the other one
                knots = track is not None and track.profile is not None and self.body.bends
                near = ROUNDING * float(ramps["span"][0]) if knots else -1.0
                return tuple(Jump(*row) for row in rows.tolist() if abs(row[4]) > near)
            error = CommandError(self._describe_runaway(state, scratch, int(runaway))) if runaway else None
            state.restore(kept[0])
            account[:] = kept[1]
            if error is not None:
                raise error
            room = count  # all jumps find room next time

    def follow_many(
        self,
        state: LineState,
        scratch: Scratch,
        targets: np.ndarray,
        rows: np.ndarray,
        legs: np.ndarray,
        budget: int,
        accounts: np.ndarray,
        spent: np.ndarray,
        records: np.ndarray,
    ) -> None:
        """Follow straight ramps exactly, for each variation of the body on ground without patches.

        Args:
            state: of all variations, its arrays with a leading axis, changed in place.
            scratch: memory from `scratch`.
            targets: targets to choose from, shape (M, W, F).
            rows: which of them end the ramps, the same for all variations, shape (V,).
            legs: the ramps at which the account is read, increasing from 0 to V, shape (L + 1,).
            budget: upper limit of work in one ramp.
            accounts: total accounts, shape (M, 15), added to.
            spent: output: work and dissipation since the start of the call at each end of a leg, shape (M, L, 2) [J].
            records: output: displacement, its rest and tension after each ramp, shape (M, V, 2 N + S).
        """
        scratch.budget[0], scratch.exact[0] = budget, True
        output = (accounts, spent, records)
        targets = np.ascontiguousarray(targets)
        _follow_many(state.contacts, state.springs, scratch.ramps, scratch.memory, targets, (rows, legs), output)

    def _describe_runaway(self, state: LineState, scratch: Scratch, direction: int) -> str:
        """Build the message about what nothing holds: a part of the body, or all of it on the ground it reaches."""
        side = "forward" if direction > 0 else "backward"
        loose = abs(int(scratch.ramps["search"]["loose"][0]))
        if (loose and self.body.bends) or self.track is None or state.feet is None:
            name = self.body.name_of(max(loose - 1, 0))
            return (
                f"loads: no link that is taut holds {name} when it is pulled {side}, and friction there is less than "
                "the loads: no equilibrium, it would run away"
            )
        commanded = np.concatenate([state.feet[name] for name in ("forward", "backward", "load")])
        at = self.body.position + state.displacement
        forward, backward, load = self.track.bounds(commanded, state.feet["place"], at)
        if self.track.couplings:
            more = add_friction(self.track.couplings, state.displacement)
            forward, backward = forward + more[0], backward + more[1]
        total, bound = float(load.sum()), float((forward if direction > 0 else backward).sum())
        return (
            f"{self.track.key}: on the ground that the contacts reach, the loads sum to {direction * total:g} N "
            f"{side}, and friction against sliding {side} to no more than {bound + direction * total:g} N: no "
            "equilibrium, the body would run away"
        )


@compiled
def _follow_many(contacts, springs, ramps, memory, targets, course, output):
    """Follow straight ramps for each variation: the records of all, and arguments of `LineMotion.follow_many`."""
    rows, legs = course
    accounts, spent, records = output
    path = np.empty((rows.shape[0], targets.shape[2]))
    for m in range(targets.shape[0]):
        for v in range(rows.shape[0]):
            for f in range(path.shape[1]):  # a slice that is assigned takes long to compile
                path[v, f] = targets[m, rows[v], f]
        for leg in range(legs.shape[0] - 1):
            first, last = legs[leg], legs[leg + 1]
            follow(contacts[m], springs[m], ramps, memory, path[first:last], accounts[m], records[m, first:last])
            spent[m, leg, 0] = accounts[m, WORK]
            spent[m, leg, 1] = dissipated(accounts[m])
