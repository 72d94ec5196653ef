"""Ramps followed by the model, all at once or row by row, and what the node sends at the ends of their ticks."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from crawler_model import Crawler
from crawler_model.body.curves import energy_of_sliders
from crawler_model.body.drive import NS
from crawler_model.body.plan import Plan
from crawler_model.body.planar_loads import split_target
from crawler_model.crawler.readout import Readout
from crawler_model.crawler.step import Step
from crawler_model.crawler.ticks import follow_ticks
from crawler_model.motion.account import AMBIGUOUS, DISSIPATION, INTERNAL, LOADS_WORK, VISITED, WORK, empty_account
from crawler_model.run.account import average_displacement
from crawler_model.run.screw import to_frame
from crawler_model.run.trajectory import TimedJump
from crawler_model.theory.stasis import bound_distances, stasis_bounds

from ..wire.messages import find_orientation
from .ledger import Ramps
from .parts import parts_of
from .ramps import Piece

_NOISE = 1e-14
"""Displacements below this fraction of the body's length are rounding."""
_NO_ACCOUNT = empty_account()
Rows = Any
"""A list of rows, or a whole array."""


class RampRows:
    """The states at the ends of the ramps of some ticks, row by row or as whole arrays; builds a piece of them."""

    def __init__(self, scene: Plan, widths: tuple[int, int], run: int, ramps: Ramps) -> None:
        """Start without states.

        Args:
            scene: the scene that runs.
            widths: numbers of entries of joint_states and of contact_states.
            run: number of the run between resets.
            ramps: the ramps.
        """
        self._scene, self._widths, self._parts = scene, widths, parts_of(scene.body)
        self.run, self.ramps = run, ramps
        self._targets = scene.columns.target(ramps.rows)
        self._lengths: Rows = []
        self._x: Rows = []
        self._shape: Rows = []
        self._tension: Rows = []
        self._gained: Rows = []
        self._places: list[np.ndarray | None] = []
        self._accounts: Rows = []
        self._losses: list[float] = []
        self._remembered: list[float] = []
        self._own_margins: list[np.ndarray] = []
        self._yaw: list[float] = []
        self._stability: list[float | None] = []
        self._jumps: list[tuple[int, TimedJump]] = []
        self.joints: Rows = []
        """Of each tick, as from `Readout.read`."""
        self.contacts: Rows = []
        self.poses: Rows = []
        """The numbers of a pose, shape (7,) of each tick."""

    def follow_at_once(self, crawler: Crawler, readout: Readout, seconds: np.ndarray) -> None:
        """Follow all ramps in compiled calls.

        Args:
            crawler: the crawler at their start, for which `runs_in_one_call` is true, without elements of hysteresis.
            readout: readout of the scene.
            seconds: as for `read`, of each tick, shape (K,).
        """
        ramps, body, before = self.ramps, self._scene.body, crawler.copy()
        targets = self._scene.columns.target(ramps.ticks.rows)
        self.joints, self.contacts, moved, accounts = self._run(crawler, readout, targets, ramps.ticks.first, seconds)
        self.poses = np.zeros((seconds.size, 7))
        self.poses[:, 0], self.poses[:, 6] = np.vecdot(moved[:, 0], body.share), 1.0
        joints = self.joints
        if not ramps.moves.all() or ramps.moves.size > seconds.size:  # some ticks have no ramp, several, or rest
            first = np.append(0, np.cumsum(ramps.moves))
            none = np.full(ramps.moves.size, np.nan)
            joints, _, moved, accounts = self._run(before, readout, targets, first, none)
            accounts[~ramps.moves] = _NO_ACCOUNT
        self._x, self._gained, self._accounts = moved[:, 0], moved[:, 1], accounts
        self._shape, self._tension = np.empty((2, ramps.moves.size, body.springs))
        self._shape[:, body.link_springs], self._tension[:, body.link_springs] = joints[:, 0, 1:], joints[:, 2, 1:]
        self._lengths = self._targets[:, : body.springs]
        self._losses = self._remembered = [0.0] * ramps.moves.size

    def _run(
        self, crawler: Crawler, readout: Readout, targets: np.ndarray, first: np.ndarray, seconds: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Follow the targets as ticks; return joints, contacts, what moved, and accounts."""
        count, (joints, contacts) = seconds.size, self._widths
        shapes = (count, 3, joints), (count, 3, contacts), (count, 2, crawler.body.contacts)
        of_joints, of_contacts, moved = map(np.empty, shapes)
        tables = np.ones(count, np.bool_), of_joints, of_contacts, moved
        return of_joints, of_contacts, moved, follow_ticks(crawler, readout, targets, first, seconds, *tables)

    def follow_each(self, crawler: Crawler, readout: Readout, seconds: np.ndarray) -> None:
        """Follow the ramps one after another.

        Args:
            crawler: the crawler at their start.
            readout: readout of the scene.
            seconds: as for `read`, of each tick, shape (K,).
        """
        ramps, ramp = self.ramps, 0
        targets = self._scene.columns.target(ramps.ticks.rows)
        for tick, (first, last) in enumerate(itertools.pairwise(ramps.ticks.first.tolist())):
            whole = crawler
            if last > first + 1:
                # the node follows a tick in one call: its displacements are the sums over the ramps up to rounding
                whole = crawler.copy()
                whole.follow(targets[first:last])
            elif last == first:
                crawler.follow(targets[:0])
            for target in targets[first:last]:
                self.add_ramp(ramp, crawler, crawler.follow(target[None]))
                ramp += 1
            if ramp < ramps.first[tick + 1]:
                self.add_ramp(ramp, crawler, None)
                ramp += 1
            self.read(readout, whole, seconds[tick])

    def add_ramp(self, ramp: int, crawler: Crawler, step: Step | None) -> None:
        """Add a ramp that was just followed, or rest.

        Args:
            ramp: its number.
            crawler: the crawler at its end.
            step: the response to this ramp; None where nothing was commanded, and nothing moved.
        """
        self._lengths.append(crawler.actuation)
        self._x.append(crawler.displacement.copy())
        self._shape.append(crawler.shape.copy())
        self._tension.append(crawler.tension.copy())
        self._gained.append(np.zeros_like(crawler.gained) if step is None else crawler.gained.copy())
        self._places.append(crawler.places)
        self._accounts.append(_NO_ACCOUNT if step is None else step.account)
        if crawler.body.turning is not None or self._standing:  # they depend on frames of points, on walls and regions
            self._own_margins.append(crawler.margins)
        if crawler.body.turning is not None:
            self._yaw.append(crawler.yaw)
            self._stability.append(crawler.stability_margin)
        self._remembered.append(energy_of_sliders(crawler.body.bends, crawler.hysteresis))
        self._losses.append(0.0 if step is None else step.jump_loss)
        start_ns, until_ns = int(self.ramps.start_ns[ramp]), int(self.ramps.until_ns[ramp])
        for jump in () if step is None else step.jumps:
            when = (start_ns + jump.fraction * (until_ns - start_ns)) / NS
            self._jumps.append((self.run, TimedJump(when, jump.contact, jump.border, jump.distance, jump.loss)))

    def read(self, readout: Readout, crawler: Crawler, seconds: float) -> None:
        """Add the contents of the topics at the end of a tick.

        Args:
            readout: readout of the scene.
            crawler: the crawler at the end of the tick, reached in one step.
            seconds: duration of the tick [s]; infinite at the start, NaN when it is not known.
        """
        joints, contacts = np.empty((3, self._widths[0])), np.empty((3, self._widths[1]))
        readout.read(crawler, seconds, joints, contacts)
        self.joints.append(joints)
        self.contacts.append(contacts)
        x, y = np.resize(np.append(crawler.net_translation, 0.0), 2).tolist()
        self.poses.append((x, y, 0.0, 0.0, 0.0, *find_orientation(crawler.yaw)))

    def piece(self, shown: np.ndarray) -> Piece:
        """Build a piece of all ramps.

        Args:
            shown: the contacts in contact_states, shape (M,).

        Returns:
            The piece.
        """
        body = self._scene.body
        x, tension, gained = np.array(self._x), np.array(self._tension), np.array(self._gained)
        shape, target, account = np.array(self._shape), self._local_targets(), np.array(self._accounts)
        force = body.force_at(x, tension)
        ground = -(force + self._loads(target))
        margins = self._margins(force, target)
        least, most = self._bounds(tension, target)
        # a contact that reaches its bound as a ramp ends may move by rounding: that is not a slip
        noise = _NOISE * max(float(np.abs(shape).max(initial=0.0)), float(np.ptp(body.position, axis=0).max()))
        gained = np.where(np.abs(gained) > noise, gained, 0.0)
        slid = gained.copy()
        slid[:, body.share == 0.0] = 0.0  # points that do not touch the ground
        forward, backward = self._parts.slid(slid if body.turning is None else to_frame(body, x, slid))
        return Piece(
            run=np.full(self.ramps.moves.size, self.run),
            start_ns=self.ramps.start_ns,
            end_ns=self.ramps.until_ns,
            ends_tick=self.ramps.ends_tick,
            command=self.ramps.rows,
            position=(body.position + x)[:, shown],
            gained=gained[:, shown],
            station_gained=slid[:, self._parts.stations],
            forward=forward,
            backward=backward,
            ground=ground[:, shown],
            elongation=shape if body.turning is not None else _over_joints(body.joint_sum, shape),
            tension=tension if body.turning is not None else _over_joints(body.joint_mean, tension),
            least=least,
            most=most,
            net_translation=average_displacement(body, x),
            work=account[:, WORK],
            loads_work=account[:, LOADS_WORK],
            dissipation=account[:, DISSIPATION] + account[:, LOADS_WORK],
            jump_loss=np.array(self._losses),
            internal_dissipation=account[:, INTERNAL],
            stored=body.energy(tension, x, np.array(self._lengths)) + np.array(self._remembered),
            margin=margins.min(axis=1),
            nearest=margins.argmin(axis=1),
            visited=account[:, VISITED],
            unique=account[:, AMBIGUOUS] == 0.0,
            jumps=tuple(self._jumps),
            yaw=np.array(self._yaw) if body.turning is not None else None,
            origin=None if body.turning is None else x[:, body.turning.heading].mean(axis=1),
            stability=np.array(self._stability, np.float64) if body.turning is not None else None,
        )

    @property
    def _standing(self) -> bool:
        """Whether contacts may stand at walls, which hold any force, or on borders of regions."""
        ground = self._scene.ground
        return ground.regions is not None or (ground.track is not None and ground.track.walls is not None)

    def _local_targets(self) -> np.ndarray:
        """Return the targets, with the bounds and loads of the ground under each contact."""
        target, track = self._targets, self._scene.ground.track
        if track is None:
            return target
        body, springs = self._scene.body, self._scene.body.springs
        at = body.position + np.array(self._x)
        return np.hstack((target[:, :springs], *track.bounds(target[:, springs:], np.array(self._places), at)))

    def _margins(self, force: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Compute each contact's distance from its nearest bound, shape (R, N)."""
        body, scene = self._scene.body, self._scene
        n, lengths = body.contacts, body.lengths
        if self._standing:
            return np.array(self._own_margins)
        if body.dimension == 1:
            forward, backward = target[:, lengths : lengths + n], target[:, lengths + n : lengths + 2 * n]
            return bound_distances(force, forward, backward)
        if body.turning is not None:
            return np.where(body.share > 0.0, np.array(self._own_margins), np.inf)
        _, friction, _ = split_target(body, scene.directions, target)
        force = force + self._loads(target)
        if scene.directions.size == 0:
            return friction[..., 0] - np.linalg.norm(force, axis=2)
        return (friction - force @ scene.directions.T).min(axis=2)

    def _loads(self, target: np.ndarray) -> np.ndarray | float:
        """Return the loads on the contacts, shape (R, N), in the plane (R, N, 2) [N]; 0 without loads."""
        scene = self._scene
        if scene.columns.slope_load is None and scene.ground.track is None:
            return 0.0
        shape = scene.body.position.shape
        return target[:, target.shape[1] - math.prod(shape) :].reshape(-1, *shape)

    def _bounds(self, tension: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Compute the bounds of each link's tension; NaN where the body is not a chain of links."""
        body = self._scene.body
        if body.dimension == 2 or not body.is_chain or body.segments:
            nothing = np.full((tension.shape[0], body.joints.shape[0]), np.nan)
            return nothing, nothing
        s, n = body.springs, body.contacts
        return stasis_bounds(tension, target[:, s : s + n], target[:, s + n : s + 2 * n])


def _over_joints(combine: Callable[[np.ndarray], np.ndarray], values: np.ndarray) -> np.ndarray:
    """Combine values of springs over the joints, for many rows at once, shape (R, S, ...) to (R, J, ...)."""
    return np.ascontiguousarray(np.moveaxis(combine(np.moveaxis(values, 0, -1)), -1, 0))
