"""Many environments on one scene: their states, and the step of all of them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from crawler_model import CommandError, Crawler, Scene
from crawler_model.crawler.crawler import default_budget
from crawler_model.crawler.readout import Readout
from crawler_model.motion.follow import build_motion
from crawler_model.motion.state import LINK_ROWS, SHAPE, TENSION
from crawler_model.run.ticks import tick_end_ns
from crawler_model.sweep.workers import available_cores
from crawler_ros.wire.states import shown_contacts

from .kernel import lane, plan
from .memory import build_shared, fill_at_rest, has_kernel, view
from .randomise import assemble, vary_scene
from .spec import Spec

_WORTH_A_THREAD = 1024
"""Contacts times environments above which another thread saves more than it costs."""


class Lanes:
    """The states of M environments on variations of one scene.

    Attributes:
        observations: of all environments, shape (M, O).
        results: rows REWARD .. TRUNCATED of each, shape (M, 6).
        actions: written before `step`, shape (M, A).
        skipped: 1 for environments that the next step leaves as they are, shape (M,).
        log: for each step of each environment the command and the readings, see `kernel.lane.observe`.
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
        scene, actions = spec.scene, len(spec.actions.names)
        self.shared = build_shared(
            scene,
            spec.actions,
            spec.task,
            spec.spans,
            spec.price,
            spec.rate,
            spec.steps,
            spec.ranges.most_delay + 1,
        )
        shared = self.shared
        self._memory = np.zeros((count, shared.lane_at[-1]))
        self._clocks = np.zeros((count, 4), np.int64)
        self._status = np.zeros((count, scene.body.contacts), np.int8)
        self.actions = np.zeros((count, actions))
        self.skipped = self._clocks[:, plan.SKIPPED]
        self.observations = view(self._memory, shared, plan.OBSERVATION)
        self.results = view(self._memory, shared, plan.RESULT)
        rows = (spec.steps or 10_000) + 1 if logs else 0
        axes = scene.dimension
        widths = [shared.lane_at[k + 1] - shared.lane_at[k] for k in (plan.ROW, plan.JOINTS, plan.FEET)]
        self.log = np.zeros((count, rows, int(sum(widths)) + axes * scene.body.contacts))
        self._has_kernel = has_kernel(scene)
        self._segments = bool(scene.body.segments)
        self._crawlers: list[Crawler] = []
        self._start = np.zeros((1, shared.lane_at[-1])), np.zeros((1, scene.body.contacts), np.int8)
        if self._has_kernel:
            fill_at_rest(*self._start, shared, scene)
            self._prepare_kernel(threads)
        else:
            self._readout = Readout(scene.body, shown_contacts(scene.body))
            self._crawlers = [Crawler(scene)] * count

    def _prepare_kernel(self, threads: int | None) -> None:
        """Collect the arguments of the kernel, for each thread."""
        body = self.spec.scene.body
        motion: Any = build_motion(self.spec.scene)
        if threads is None:
            threads = min(available_cores(), max(self.count * body.contacts // _WORTH_A_THREAD, 1))
        if body.is_chain:
            from .kernel.chain import step_chains as kernel
        else:
            from .kernel.graph import step_graphs as kernel
        self._kernel: Any = kernel
        edges = np.linspace(0, self.count, threads + 1).astype(int).tolist()
        self._blocks: list[tuple[Any, ...]] = []
        for first, last in itertools.pairwise(edges):
            some = slice(first, last)
            scratch = motion.scratch()
            if not body.is_chain:
                scratch = (tuple(motion.network.layout), *scratch)
            self._blocks.append(
                (
                    self._memory[some],
                    self._clocks[some],
                    self._status[some],
                    self.actions[some],
                    self.shared.floats,
                    self.shared.ints,
                    body.share,
                    body.element_ends,
                    default_budget(body),
                    *scratch,
                    not self._segments,
                    self.log[some],
                )
            )
        self._first = self._blocks[0]
        self._pool = ThreadPoolExecutor(threads - 1) if threads > 1 else None

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
            block, status = self._start
            if scenes is not None:
                block = np.zeros((which.size, self._memory.shape[1]))
                status = np.zeros((which.size, self._status.shape[1]), np.int8)
                fill_at_rest(block, status, self.shared, assemble(scenes).assembly)
            self._memory[which], self._status[which] = block, status
        else:
            varied = [self.spec.scene] * which.size if scenes is None else [scenes[k] for k in range(which.size)]
            self._memory[which] = 0.0
            for m, scene in zip(which.tolist(), varied, strict=True):
                self._crawlers[m] = Crawler(scene)
                view(self._memory, self.shared, plan.ROW)[m] = self._crawlers[m].row
        self._clocks[which, plan.STEP] = 0
        self._clocks[which, plan.DELAY] = [one.get("delay", 0) for one in drawn]
        self._clocks[which, plan.RANDOM] = [one.get("noise_seed", 0) for one in drawn]
        view(self._memory, self.shared, plan.SIGMA)[which, 0] = [one.get("noise", 0.0) for one in drawn]
        self.skipped[which] = 0
        self._begin(which)

    def _begin(self, which: np.ndarray) -> None:
        if self._has_kernel:
            shared = self.shared
            lane.begin_episodes(
                self._memory, self._clocks, which, shared.floats, shared.ints, not self._segments, self.log
            )
        if not self._has_kernel or self._segments:
            self._complete(which, True)

    # -- steps ------------------------------------------------------------------------------------------------------

    def step(self) -> None:
        """Follow `actions`, which must be finite, for one step, in all environments that are not skipped."""
        if not self._has_kernel:
            for m in np.flatnonzero(self.skipped == 0).tolist():
                self._follow(m)
        elif self._pool is None:
            self._kernel(*self._first)
        else:
            waiting = [self._pool.submit(self._kernel, *block) for block in self._blocks[1:]]
            self._kernel(*self._first)
            for each in waiting:
                each.result()
        if not self._has_kernel or self._segments:
            self._complete(np.flatnonzero(self.skipped == 0), False)

    def _follow(self, m: int) -> None:
        """Follow the action of one environment in the plane, or on patches of ground."""
        memory, shared, crawler = self._memory[m], self.shared, self._crawlers[m]
        row = view(self._memory, shared, plan.ROW)[m]
        held = row.copy()
        lane.command_one(memory, self._clocks[m], self.actions[m], shared.floats, shared.ints)
        columns = crawler.scene.columns
        try:
            target = np.array(columns.target(row))
            columns.check_equilibrium(target, "command", CommandError)
            step = crawler.follow(target[None])
        except CommandError:  # friction cannot hold the loads: the command in force stays
            row[:] = held
            step = crawler.follow(np.empty((0, columns.index.size)))
        view(self._memory, shared, plan.ACCOUNT)[m] = step.account

    def _complete(self, which: np.ndarray, first: bool) -> None:
        """Add the readings that kernels do not read, and observe."""
        shared, scene = self.shared, self.spec.scene
        joints = view(self._memory, shared, plan.JOINTS)
        joints = view(self._memory, shared, plan.JOINTS, 3, joints.shape[1] // 3)
        feet = view(self._memory, shared, plan.FEET)
        feet = view(self._memory, shared, plan.FEET, 3, feet.shape[1] // 3)
        if self._has_kernel:
            body = scene.body
            links = view(self._memory, shared, plan.LINKS, LINK_ROWS, body.springs)
            for m in which.tolist():
                joints[m, 0, 1:] = body.joint_sum(links[m, SHAPE])
                joints[m, 2, 1:] = body.joint_mean(links[m, TENSION])
        else:
            contacts = view(self._memory, shared, plan.CONTACTS)
            for m in which.tolist():
                tick, rate = int(self._clocks[m, plan.STEP]), self.spec.rate
                seconds = np.inf if first else (tick_end_ns(tick + 1, rate) - tick_end_ns(tick, rate)) / 1_000_000_000
                self._readout.read(self._crawlers[m], seconds, joints[m], feet[m])
                contacts[m] = self._crawlers[m].displacement.ravel()
        lane.observe_some(self._memory, self._clocks, which, shared.floats, shared.ints, first, self.log)

    # -- another body -----------------------------------------------------------------------------------------------

    def choose_row(self) -> np.ndarray:
        """Turn the action of the first environment into a command for another body, such as a robot's.

        Returns:
            The command row, shape (C,).
        """
        shared = self.shared
        lane.command_one(self._memory[0], self._clocks[0], self.actions[0], shared.floats, shared.ints)
        return self.row(0)

    def observe_readings(self, first: bool, joints: np.ndarray, contacts: np.ndarray) -> None:
        """Observe the readings of another body in the first environment.

        Args:
            first: whether an episode begins.
            joints: positions, velocities and efforts of joint_states, shape (3, W).
            contacts: those of contact_states, shape (3, K).
        """
        shared, which = self.shared, np.zeros(1, np.int64)
        view(self._memory, shared, plan.JOINTS)[0] = joints.ravel()
        view(self._memory, shared, plan.FEET)[0] = contacts.ravel()
        lane.observe_some(self._memory, self._clocks, which, shared.floats, shared.ints, first, self.log)

    # -- readings ---------------------------------------------------------------------------------------------------

    def steps_done(self, m: int) -> int:
        """Count the steps of the present episode of environment m."""
        return int(self._clocks[m, plan.STEP])

    def displacement(self, m: int) -> np.ndarray:
        """Read the displacement of environment m, shape (N,), in the plane (N, 2) [m]."""
        body = self.spec.scene.body
        part = view(self._memory, self.shared, plan.CONTACTS)[m, : body.contacts * body.dimension]
        return part.reshape(body.position.shape).copy()

    def row(self, m: int) -> np.ndarray:
        """Read the command row in force in environment m, shape (C,)."""
        return view(self._memory, self.shared, plan.ROW)[m].copy()

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
