"""The ticks of a simulator, one or many at once: take commands, follow them, send the states, count."""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from crawler_model import CommandError, Crawler, Scene, prepare
from crawler_model.body.drive import NS
from crawler_model.crawler.readout import find_turn
from crawler_model.crawler.ticks import follow_ticks, runs_in_one_call
from crawler_model.motion.account import ACCOUNT_SIZE
from crawler_model.motion.jump import Jump
from crawler_model.run.screw import to_frame

from ..viewer.frames import time_jumps
from ..wire.messages import find_orientation
from .actuators import Actuators
from .counts import start_counts
from .encoder import LEDGER, STATES, TickEncoder
from .inertia import add_ticks
from .intake.commanded_path import CommandedPath, Vertex, Vertices
from .intake.commands import CommandQueue
from .intake.intake import Intake
from .kernels import sum_accounts
from .measured import MeasuredTopics
from .outgoing import Outgoing
from .tick_clock import TickClock

if TYPE_CHECKING:
    from ..viewer.feed import ViewerFeed

_CALL_NS = 2_000_000
"""Processor time of a call [ns], to which the number of its ticks is adjusted: commands and services wait as long."""

_Jumps = dict[int, Sequence[Jump]]


class Ticks:
    """Runs ticks of a crawler and keeps what is counted of them; under the lock of the node."""

    def __init__(
        self,
        scene: Scene,
        crawler: Crawler,
        tick_clock: TickClock,
        commands: CommandQueue,
        intake: Intake,
        outgoing: Outgoing,
        feed: ViewerFeed | None,
        every: int,
        actuators: Actuators,
        measured: MeasuredTopics | None,
    ) -> None:
        """Keep the parts.

        Args:
            scene: the scene that runs.
            crawler: the crawler at its start.
            tick_clock: the times of the ticks.
            commands: the commands that wait.
            intake: what received them, which logs what is wrong with them.
            outgoing: the messages of ticks.
            feed: the live view, if there is one.
            every: the states are sent after each tick whose number is a multiple of this.
            actuators: what moves the links.
            measured: the messages of the sensors, if there are any.
        """
        self.crawler, self.start = crawler, crawler.copy()
        self._clock, self._commands, self._intake, self._outgoing = tick_clock, commands, intake, outgoing
        self._feed, self._every, self._actuators, self._measured = feed, every, actuators, measured
        self._scene, self._columns = scene, scene.columns
        self._count_anew()
        averages = self.inertia is not None and not self.inertia.follows_pieces  # of which each tick counts
        self._compiled = runs_in_one_call(crawler) and not averages
        self.most = outgoing.encoder.most if feed is None else 1
        """Largest number of ticks at once; the live view is shown between them."""
        self._ahead = min(self.most, 16)
        self._always = np.ones(self.most, np.bool_)
        self._moved = np.empty((self.most, 2, scene.body.contacts))

    def _count_anew(self) -> None:
        found = start_counts(self._scene, self.crawler.method)
        self.certificates, self.counts, self.yields, self.inertia = found

    def reset(self) -> None:
        """Return to the start of the scene, and send the state there."""
        self.crawler = self.start.copy()
        self._commands.reset(self.start.row)
        self._actuators.reset(self.start.row)
        self._count_anew()
        self.send_start()

    def send_start(self) -> None:
        """Send the state at simulated time 0."""
        self._read(0, np.inf)
        self._outgoing.send_start()
        if self._measured is not None:
            encoder = self._outgoing.encoder
            self._measured.send_start(encoder.joints[0], encoder.poses[0])
        if self._feed is not None:
            self._feed.show(0, self.crawler, ())

    def freeze(self, names: str) -> None:
        """Let actuators stick, see `Actuators.freeze`."""
        self._actuators.freeze(names, self._commands.in_force)

    def run_ahead(self) -> None:
        """Run as many ticks as take `_CALL_NS`, or fewer where commands wait."""
        used, before = time.thread_time_ns(), self._clock.tick
        self.run(self._ahead)
        used, count = time.thread_time_ns() - used, self._clock.tick - before
        self._ahead = max(1, min(self.most, 2 * self._ahead, 1 + count * _CALL_NS // max(used, 1)))

    def run(self, most: int = 1, shown: bool = False) -> None:
        """Run a tick or, if no command waits, as many as can be run at once.

        Args:
            most: the largest number of ticks.
            shown: whether to send the states even where they are not due.
        """
        began_ns, tick, in_force = time.monotonic_ns(), self._clock.tick, self._commands.in_force
        taken = self._commands.take_vertices(self._clock.times_ns(min(most, self.most)))
        if not self._actuators.are_ideal:
            in_force, taken = self._actuators.row, self._actuators.move(taken)
        always = self._always[: taken.first.size - 1]
        sent = always if self._every == 1 else (np.arange(tick + 1, tick + 1 + always.size) % self._every == 0)
        if shown or taken.ended >= 0:
            sent[taken.ended] = True
        if self._clock.ends_at(int(taken.times_ns[-1])):
            sent[-1] = True
        read = sent if self.yields is None and self._measured is None else always
        x: list[np.ndarray] = []
        jumps: _Jumps = {}
        if self._compiled:
            accounts = self._follow_at_once(taken, in_force, read)
        else:
            taken, accounts = self._follow_each(taken, in_force, read, x, jumps)
            read, sent = read[: len(accounts)], sent[: len(accounts)]
            if taken.ended >= 0:  # also because its commands were refused
                sent[taken.ended] = True
        self._outgoing.send(taken, read, sent, began_ns)  # first of all: in lock-step a controller waits for it
        if self._measured is not None:
            encoder = self._outgoing.encoder
            self._measured.send(taken.times_ns[1:], encoder.joints[: sent.size], encoder.poses[: sent.size])
        self._intake.warn_of_overdue(self._clock.now_ns)
        self._clock.finish(sent.size)
        if self._feed is not None:
            start_ns, end_ns = taken.times_ns.tolist()
            dues = np.maximum(taken.due_ns, start_ns).tolist()
            self._feed.show(end_ns, self.crawler, time_jumps(jumps[0], start_ns, dues) if jumps else ())
        *certificates, ambiguous, overspent, unsolved = sum_accounts(accounts)
        self.certificates.add_ticks(*certificates)
        self.counts.add_ticks(ambiguous, overspent, unsolved)
        if self.inertia is not None:
            add_ticks(self.inertia, self._columns, taken, x, list(jumps))

    def _follow_at_once(self, taken: Vertices, in_force: np.ndarray, read: np.ndarray) -> np.ndarray:
        """Follow and read ticks in one compiled call: of bodies that cannot jump, on ground that holds everywhere.

        Returns:
            The account of each, shape (K, 15).
        """
        crawler, encoder, count = self.crawler, self._outgoing.encoder, np.count_nonzero(read)
        joints, contacts, moved = encoder.joints[:count], encoder.contacts[:count], self._moved[:count]
        targets = self._columns.target(taken.rows)
        ns = taken.times_ns[1:] - taken.times_ns[:-1]  # np.diff takes twice as long
        seconds = ns / NS
        accounts = follow_ticks(crawler, encoder.readout, targets, taken.first, seconds, read, joints, contacts, moved)
        poses = encoder.poses[:count]
        np.vecdot(moved, crawler.body.share, out=poses[:, ::4])  # x and its gain, each to the bit as one product
        if "odom" in encoder.places:
            poses[:, 4] /= seconds if count == seconds.size else seconds[read]
        if self.yields is not None:
            targets = np.vstack((self._columns.target(in_force[None]), targets))[taken.first[1:]]  # at the end of each
            self.yields.add_ticks(joints[:, 0, 1:], targets[:, crawler.body.link_springs], ns)
        return accounts

    def _follow_each(
        self, taken: Vertices, in_force: np.ndarray, read: np.ndarray, x: list[np.ndarray], jumps: _Jumps
    ) -> tuple[Vertices, np.ndarray]:
        """Follow and read ticks one after another, up to one whose commands the ground refuses: that one holds.

        Args:
            taken: what they are to follow.
            in_force: the row in force before them, shape (C,).
            read: whether to read each, shape (K,).
            x: output: displacement at the end of each, shape (N,), in the plane (N, 2) [m].
            jumps: output: the jumps of the ticks that have any.

        Returns:
            What the ticks followed, and the account of each; of fewer ticks if commands were refused.
        """
        crawler, body, row = self.crawler, self.crawler.body, 0
        targets, first = self._columns.target(taken.rows), taken.first.tolist()
        accounts, ns = np.empty((read.size, ACCOUNT_SIZE)), taken.times_ns[1:] - taken.times_ns[:-1]
        for tick in range(read.size):
            try:
                step = crawler.follow(targets[first[tick] : first[tick + 1]])
            except CommandError as error:  # only the motion shows that the ground it leads to holds nothing
                step, taken = crawler.follow(targets[:0]), taken.refuse(tick)
                last = taken.rows[-1] if taken.rows.size else in_force
                self._commands.resume(last, int(taken.times_ns[-1]))
                self._actuators.reset(last)
                self._intake.warn_of_refused_tick(error)
                self.counts.unheld += 1
                read[tick] = True
            accounts[tick] = step.account
            if read[tick]:
                self._read(row, ns[tick] / NS)
                row += 1
            self.counts.add_jumps(step.jumps, crawler.stability_margin)
            if step.jumps:
                jumps[tick] = step.jumps
            if self.yields is not None:
                lengths = body.joint_sum(crawler.actuation)
                self.yields.add_ticks(crawler.joint_elongation[None], lengths[None], ns[tick : tick + 1])
            if self.inertia is not None:
                x.append(crawler.displacement)
            if tick + 2 == taken.times_ns.size:  # the last one, perhaps because it was refused
                break
        return taken, accounts[: tick + 1]

    def _read(self, place: int, seconds: float) -> None:
        """Read the end of a tick that took some time [s], infinite at the start, into a row of what is encoded."""
        crawler, encoder, body = self.crawler, self._outgoing.encoder, self.crawler.body
        encoder.readout.read(crawler, seconds, encoder.joints[place], encoder.contacts[place])
        pose = encoder.poses[place]
        pose[: body.dimension] = crawler.net_translation
        if body.turning is not None:
            pose[2:4] = find_orientation(crawler.yaw)
        if "odom" in encoder.places:
            gain = body.share @ crawler.gained
            if body.turning is not None:  # a twist is expressed in the moving frame
                gain = to_frame(body, crawler.displacement, gain[None])[0]
            pose[4 : 4 + body.dimension], pose[6] = gain / seconds, find_turn(crawler) / seconds


def compile_ticks(scene: Scene) -> None:
    """Compile the kernels of ticks or load them.

    Args:
        scene: the scene that will run.
    """
    _skip_blas()
    prepare(scene)
    crawler, encoder = Crawler(scene), TickEncoder(scene, "", dict.fromkeys((*STATES, LEDGER), -1))
    encoder.readout.read(crawler, np.inf, encoder.joints[0], encoder.contacts[0])
    path, always = CommandedPath(Vertex(0, crawler.row)), np.ones(1, np.bool_)
    path.replace(0, [Vertex(1, crawler.row)])
    taken = path.pass_waypoints(np.arange(2), crawler.row)
    encoder.encode(taken, True, always, always, (0, 0, np.zeros(0, np.int64)))
    accounts = np.zeros((1, ACCOUNT_SIZE))
    if runs_in_one_call(crawler):
        targets, moved = scene.columns.target(taken.rows), np.empty((1, 2, scene.body.contacts))
        tables = encoder.joints[:1], encoder.contacts[:1], moved
        accounts = follow_ticks(crawler, encoder.readout, targets, taken.first, np.ones(1), always, *tables)
    sum_accounts(accounts)


def _skip_blas() -> None:
    """Let numba find no BLAS: it would import scipy.linalg, a tenth of the node's start, for np.cov in kernels.

    This is done here and not where kernels are loaded, because other programs may compile functions of their own.
    """
    hidden = "scipy.linalg"
    if hidden in sys.modules:
        return
    sys.modules[hidden] = None  # type: ignore[assignment]
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        del sys.modules[hidden]
