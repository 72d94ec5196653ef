"""The ticks of a simulator, one by one or many at once: take commands, follow them, send the states, count."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from crawler_model import CommandError, Crawler, Scene
from crawler_model.body.drive import NS
from crawler_model.crawler.ticks import runs_in_one_call

from ..viewer.frames import time_jumps
from .counts import start_counts
from .inertia import add_tick, add_ticks
from .intake.commands import CommandQueue
from .intake.intake import Intake
from .outgoing import Outgoing
from .stepper import Stepper
from .tick_batch import TickBatch

if TYPE_CHECKING:
    from ..recording.recorder import Recorder
    from ..viewer.feed import ViewerFeed


class Ticks:
    """Runs ticks of a crawler and keeps what is counted of them; under the lock of the node."""

    def __init__(
        self,
        scene: Scene,
        crawler: Crawler,
        stepper: Stepper,
        commands: CommandQueue,
        intake: Intake,
        outgoing: Outgoing,
        recorder: Recorder | None,
        feed: ViewerFeed | None,
        every: int,
    ) -> None:
        """Keep the parts.

        Args:
            scene: the scene that runs.
            crawler: the crawler at its start.
            stepper: the times of the ticks.
            commands: the commands that wait.
            intake: what received them, which logs what is wrong with them.
            outgoing: the messages of a tick.
            recorder: the recorder, if there is one.
            feed: the live view, if there is one.
            every: the states are sent after each tick whose number is a multiple of this.
        """
        self.crawler, self.start = crawler, crawler.copy()
        self._stepper, self._commands, self._intake, self._outgoing = stepper, commands, intake, outgoing
        self._feed, self._every = feed, every
        self._scene, self._columns = scene, scene.columns
        self._hold = np.empty((0, self._columns.index.size))
        single = feed is not None or not runs_in_one_call(crawler)
        self.batch = None if single else TickBatch(scene, outgoing, recorder, every)
        """What runs many ticks at once; None where they run one by one."""
        self._count_anew()

    def _count_anew(self) -> None:
        found = start_counts(self._scene, self.crawler.method)
        self.certificates, self.counts, self.yields, self.inertia = found

    def reset(self) -> None:
        """Return to the start of the scene, and send the state there."""
        self.crawler = self.start.copy()
        self._commands.reset(self.start.row)
        self._count_anew()
        self.send_start()

    def send_start(self) -> None:
        """Send the state at simulated time 0."""
        self._outgoing.resend(newcomers=False)  # later subscribers get the state, at worst twice
        self._outgoing.send_states(self.crawler, 0, np.inf)
        if self._feed is not None:
            self._feed.show(0, self.crawler, ())

    def run(self, shown: bool = False) -> None:
        """Run a tick; send its states if `shown`, or if they are due."""
        start_ns, end_ns = self._stepper.now_ns, self._stepper.next_ns
        in_force = self._commands.in_force
        vertices = self._commands.take(start_ns, end_ns)
        self._intake.warn_of_overdue(start_ns)
        rows = [v.row for v in vertices]
        try:
            step = self.crawler.follow(self._columns.target(np.array(rows)) if rows else self._hold)
        except CommandError as error:  # only the motion shows that the ground it leads to holds nothing
            self.counts.unheld += 1
            self._intake.warn_of_refused_tick(error)
            self._commands.resume(in_force)
            vertices = []
            step = self.crawler.follow(self._hold)
        self._stepper.finish()
        self._outgoing.record_ledger(start_ns, vertices)
        if shown or self._commands.ended or self._stepper.tick % self._every == 0:
            self._outgoing.send_states(self.crawler, end_ns, (end_ns - start_ns) / NS)
        self._outgoing.publish_ledger(start_ns, vertices)  # a controller waits only for the states
        if self._feed is not None:
            dues = [max(v.due_ns, start_ns) for v in vertices]
            self._feed.show(end_ns, self.crawler, time_jumps(step.jumps, start_ns, dues) if step.jumps else ())
        self.certificates.add(step.account)
        self.counts.add(step, self.crawler.stability_margin)
        if self.yields is not None:
            self.yields.add(self.crawler, end_ns - start_ns)
        add_tick(self.inertia, self.crawler, step, vertices, (start_ns, end_ns))

    def run_many(self) -> bool:
        """Run many ticks at once if no command waits; return whether any were run."""
        if self.batch is None:
            return False
        start_ns, ends = self._stepper.now_ns, self._stepper.ends_ns(self.batch.ticks)
        taken = self._commands.take_ahead(start_ns, ends)
        if taken is None:
            return False
        ends = ends[: taken.first.size - 1]
        accounts = self.batch.run(self.crawler, taken, self._stepper.tick, start_ns, ends, self.yields)
        self._stepper.finish(len(accounts))
        add_ticks(self.inertia, self._columns, taken, start_ns, ends)
        self.certificates.add_many(accounts)
        self.counts.add_many(accounts)
        return True
