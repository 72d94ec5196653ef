"""Many environments on one scene: their states, and the step of all of them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from crawler_model import CommandError, Crawler, Scene
from crawler_model.body.plan import Plan
from crawler_model.crawler.budget import default_budget
from crawler_model.crawler.readout import Readout
from crawler_model.motion.line.motion import LineMotion, LineState
from crawler_model.run.ticks import tick_end_ns
from crawler_model.scene.sensors import Sensors
from crawler_ros.wire.states import find_command, shown_contacts

from ..sweep.workers import available_cores
from .kernel import layout
from .kernel.command import command_one
from .kernel.observe import observe_some
from .memory import build_shared, fill_at_rest, has_kernel, view
from .randomise import assemble, vary_scene
from .spec import Spec, list_units

_WORTH_A_THREAD = 1024
"""Contacts times environments above which another thread saves more than it costs."""


class Lanes:
    """The states of M environments on variations of one scene.

    Attributes:
        observations: of all environments, shape (M, O).
        results: rows REWARD .. TRUNCATED of each, shape (M, 6).
        actions: written before `step`, shape (M, A).
        skipped: 1 for environments that the next step leaves as they are, shape (M,).
        log: for each step of each environment the command and the readings, see `kernel.observe`.
    """

    def __init__(self, spec: Spec, count: int, logs: bool = False, threads: int | None = None) -> None:
        """Allocate the memory of the environments; `reset` begins their episodes.

        Args:
            spec: their settings.
            count: number of environments M.
            logs: whether to log the steps.
            threads: number of threads; None for one per core where that pays.
        """
        self.spec, self.count = spec, count
        self._given = spec, count, logs, threads
        scene, actions = spec.scene, len(spec.actions.names)
        shared = self.shared = build_shared(spec)
        self._memory = np.zeros((count, shared.lane_at[-1]))
        self._clocks = np.zeros((count, 4), np.int64)
        self.actions = np.zeros((count, actions))
        self.skipped = self._clocks[:, layout.SKIPPED]
        self.observations = view(self._memory, shared, layout.OBSERVATION)
        self.results = view(self._memory, shared, layout.RESULT)
        rows = (spec.steps or 10_000) + 1 if logs else 0
        logged = (layout.ROW, layout.JOINTS, layout.FEET, layout.DISPLACEMENT)
        width = sum(int(shared.lane_at[k + 1] - shared.lane_at[k]) for k in logged)
        self.log = np.zeros((count, rows, width))
        self._has_kernel = has_kernel(scene)
        self._segments = bool(scene.body.segments)
        self._crawlers: list[Crawler] = []
        self._bodies: tuple[np.ndarray, ...] = ()
        self._readout = Readout(scene.body, shown_contacts(scene.body))
        sensors = scene.parts.sensors
        units = [] if sensors is None else list_units(spec)
        self._sensors = [] if sensors is None else [Sensors(sensors, units, float(spec.rate)) for _ in range(count)]
        if self._has_kernel:
            self._rest = np.zeros((1, shared.lane_at[-1]))
            fill_at_rest(self._rest, shared, scene)
            self._prepare_kernel(threads)
        else:
            self._crawlers = [Crawler(scene)] * count

    def _prepare_kernel(self, threads: int | None) -> None:
        """Collect the arguments of the kernel, for each thread."""
        from .kernel import step

        self._kernels = step
        body, count = self.spec.scene.body, self.count
        motion = LineMotion(body)
        self._state = self._at_rest(self.spec.scene)
        self._bodies = (np.repeat(self._state.contacts[None], count, 0), np.repeat(self._state.springs[None], count, 0))
        self._readings = (self.shared.floats, self.shared.ints, self._readout.seen, not self._segments)
        if threads is None:
            threads = min(available_cores(), max(count * body.contacts // _WORTH_A_THREAD, 1))
        edges = np.linspace(0, count, threads + 1).astype(int).tolist()
        self._blocks: list[tuple[Any, ...]] = []
        for first, last in itertools.pairwise(edges):
            some = slice(first, last)
            scratch = motion.scratch()
            scratch.budget[0], scratch.exact[0] = default_budget(body), True
            bodies = (self._bodies[0][some], self._bodies[1][some])
            state = (self._memory[some], self._clocks[some], bodies, self.actions[some])
            self._blocks.append((*state, self._readings, scratch[:2], self.log[some]))
        self._first = self._blocks[0]
        self._pool = ThreadPoolExecutor(threads - 1) if threads > 1 else None

    def _at_rest(self, plan: Plan) -> LineState:
        """Build the state at the start of a scene, or of variations of it."""
        return LineMotion(plan.body).start(plan.start_displacement, plan.drive.targets[..., 0, :])

    @property
    def _arrays(self) -> tuple[np.ndarray, ...]:
        """All that changes; the other arrays are views of these."""
        return self._memory, self._clocks, self.actions, self.log, *self._bodies

    def __reduce__(self) -> tuple[Any, ...]:
        """Let copies be built anew: copied one by one, views would be arrays of their own."""
        return Lanes, self._given, (self.spec, self._crawlers, self._sensors, self._arrays)

    def __setstate__(self, state: tuple[Spec, list[Crawler], list[Sensors], tuple[np.ndarray, ...]]) -> None:
        self.spec, self._crawlers, self._sensors, arrays = state
        for own, given in zip(self._arrays, arrays, strict=True):
            own[...] = given

    def close(self) -> None:
        """End the threads."""
        if self._has_kernel and self._pool is not None:
            self._pool.shutdown()

    # -- episodes ---------------------------------------------------------------------------------------------------

    def reset(self, which: np.ndarray, drawn: Sequence[dict[str, Any]]) -> None:
        """Begin episodes.

        Args:
            which: the environments, shape (K,), int64.
            drawn: the values of each episode, from `Ranges.draw`.

        Raises:
            CrawlerError: if a scene is invalid; nothing changes.
        """
        keys = self.spec.ranges.of_scene
        scenes = None
        if keys:
            scenes = vary_scene(self.spec.scene, keys, {k: np.array([one[k] for one in drawn]) for k in keys})
        if self._has_kernel:
            block, state = self._rest, self._state
            if scenes is not None:
                block = np.zeros((which.size, self._memory.shape[1]))
                assembly = assemble(scenes).assembly
                fill_at_rest(block, self.shared, assembly)
                state = self._at_rest(assembly)
            self._memory[which] = block
            self._bodies[0][which], self._bodies[1][which] = state.contacts, state.springs
        else:
            varied = [self.spec.scene] * which.size if scenes is None else [scenes[k] for k in range(which.size)]
            self._memory[which] = 0.0
            for m, scene in zip(which.tolist(), varied, strict=True):
                self._crawlers[m] = Crawler(scene)
                view(self._memory, self.shared, layout.ROW)[m] = self._crawlers[m].row
        self._clocks[which, layout.STEP] = 0
        self._clocks[which, layout.DELAY] = [one.get("delay", 0) for one in drawn]
        self._clocks[which, layout.RANDOM] = [one.get("noise_seed", 0) for one in drawn]
        view(self._memory, self.shared, layout.SIGMA)[which, 0] = [one.get("noise", 0.0) for one in drawn]
        self.skipped[which] = 0
        self._begin(which)
        if self._sensors:
            for m, one in zip(which.tolist(), drawn, strict=True):
                self._sensors[m].restart(one.get("noise_seed", 0))
            self._measure(which)

    def _begin(self, which: np.ndarray) -> None:
        if self._has_kernel:
            self._kernels.begin_episodes(self._memory, self._clocks, self._bodies, which, self._readings, self.log)
        if not self._has_kernel or self._segments:
            self._complete(which, True)

    # -- steps ------------------------------------------------------------------------------------------------------

    def step(self) -> None:
        """Follow `actions`, which must be finite, for one step, in all environments that are not skipped."""
        if not self._has_kernel:
            for m in np.flatnonzero(self.skipped == 0).tolist():
                self._follow(m)
        elif self._pool is None:
            self._kernels.step_lanes(*self._first)
        else:
            waiting = [self._pool.submit(self._kernels.step_lanes, *block) for block in self._blocks[1:]]
            self._kernels.step_lanes(*self._first)
            for each in waiting:
                each.result()
        if not self._has_kernel or self._segments:
            self._complete(np.flatnonzero(self.skipped == 0), False)
        if self._sensors:
            self._measure(np.flatnonzero(self.skipped == 0))

    def _measure(self, which: np.ndarray) -> None:
        """Let observations be what the sensors measure: the last measurement that has arrived."""
        bound = self.spec.spans.bound
        for m in which.tolist():
            ns = tick_end_ns(int(self._clocks[m, layout.STEP]), self.spec.rate)
            self._sensors[m].measure(ns, self.observations[m])
            latest = self._sensors[m].latest
            assert latest is not None
            np.clip(latest.values, -bound, bound, out=self.observations[m])

    def _follow(self, m: int) -> None:
        """Follow the action of one environment in the plane, or on patches of ground."""
        memory, shared, crawler = self._memory[m], self.shared, self._crawlers[m]
        row = view(self._memory, shared, layout.ROW)[m]
        held = row.copy()
        command_one(memory, self._clocks[m], self.actions[m], shared.floats, shared.ints)
        columns = crawler.scene.columns
        try:
            target = np.array(columns.target(row))
            columns.check_equilibrium(target, "command", CommandError)
            step = crawler.follow(target[None])
        except CommandError:  # friction cannot hold the loads: the command in force stays
            row[:] = held
            step = crawler.follow(np.empty((0, columns.index.size)))
        view(self._memory, shared, layout.ACCOUNT)[m] = step.account

    def _complete(self, which: np.ndarray, first: bool) -> None:
        """Add the readings that kernels do not read, and observe."""
        shared, scene = self.shared, self.spec.scene
        joints = view(self._memory, shared, layout.JOINTS).reshape(self.count, 3, -1)
        feet = view(self._memory, shared, layout.FEET).reshape(self.count, 3, -1)
        if self._has_kernel:
            body, springs = scene.body, self._bodies[1]
            for m in which.tolist():
                joints[m, 0, 1:] = body.joint_sum(springs["elongation"][m])
                joints[m, 2, 1:] = body.joint_mean(springs["tension"][m])
        else:
            displacement = view(self._memory, shared, layout.DISPLACEMENT)
            for m in which.tolist():
                tick, rate = int(self._clocks[m, layout.STEP]), self.spec.rate
                seconds = np.inf if first else (tick_end_ns(tick + 1, rate) - tick_end_ns(tick, rate)) / 1_000_000_000
                self._readout.read(self._crawlers[m], seconds, joints[m], feet[m])
                displacement[m] = self._crawlers[m].displacement.ravel()
        observe_some(self._memory, self._clocks, which, shared.floats, shared.ints, first, self.log)

    # -- another body -----------------------------------------------------------------------------------------------

    def choose_row(self) -> np.ndarray:
        """Turn the action of the first environment into a command for another body, such as a robot's.

        Returns:
            The command row, shape (C,).
        """
        shared = self.shared
        command_one(self._memory[0], self._clocks[0], self.actions[0], shared.floats, shared.ints)
        return self.row(0)

    def observe_readings(self, first: bool, joints: np.ndarray, contacts: np.ndarray) -> None:
        """Observe the readings of another body in the first environment.

        Args:
            first: whether an episode begins, at the command that the readings reveal.
            joints: positions, velocities and efforts of joint_states, shape (3, W).
            contacts: the same of contact_states, shape (3, K).
        """
        shared, which = self.shared, np.zeros(1, np.int64)
        if first:
            view(self._memory, shared, layout.ROW)[0] = find_command(self.spec.scene, joints, self.row(0))
        view(self._memory, shared, layout.JOINTS)[0] = joints.ravel()
        view(self._memory, shared, layout.FEET)[0] = contacts.ravel()
        observe_some(self._memory, self._clocks, which, shared.floats, shared.ints, first, self.log)

    # -- readings ---------------------------------------------------------------------------------------------------

    def steps_done(self, m: int) -> int:
        """Count the steps of the present episode of environment m."""
        return int(self._clocks[m, layout.STEP])

    def displacement(self, m: int) -> np.ndarray:
        """Read the displacement of environment m, shape (N,), in the plane (N, 2) [m]."""
        part = view(self._memory, self.shared, layout.DISPLACEMENT)[m]
        return part.reshape(self.spec.scene.body.position.shape).copy()

    def row(self, m: int) -> np.ndarray:
        """Read the command row in force in environment m, shape (C,)."""
        return view(self._memory, self.shared, layout.ROW)[m].copy()

    def scene(self, drawn: dict[str, Any]) -> Scene:
        """Build the scene of an episode.

        Args:
            drawn: its values.

        Returns:
            The scene.
        """
        keys = self.spec.ranges.of_scene
        if not keys:
            return self.spec.scene
        return vary_scene(self.spec.scene, keys, {key: np.array([drawn[key]]) for key in keys})[0]
