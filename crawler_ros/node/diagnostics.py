"""The contents of /diagnostics: the status of the simulation, the commands, the recording and the viewer."""

from __future__ import annotations

import time
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from crawler_model.body.drive import NS
from crawler_model.run.orientation import shape_orientation
from crawler_model.theory.uniqueness import UNDETERMINED, Undecided

from ..wire.facts import REFUSED_ON, Fact, Refusal
from .intake.peers import publishers_of, rivals_on_states

if TYPE_CHECKING:  # the gait player needs none of the simulator's kernels
    from crawler_model.body.plan import Plan
    from crawler_model.theory.regularity import Regularity

    from ..viewer.feed import ViewerFeed
    from .intake.commands import CommandQueue
    from .intake.intake import Intake
    from .tick_clock import TickClock
    from .ticks import Ticks

OK, WARN, ERROR = 0, 1, 2
Status = tuple[int, str, str, str, list[tuple[str, str]]]
Entries = list[tuple[str, str]]
"""Keys (a `Fact` where the meaning is stable) and values."""
Part = tuple[int, str, Entries]
"""Level, message and key-value pairs of one part of the node."""


class TickCounts(NamedTuple):
    """Counts that were last reported, named as the run's in `Counts`, and late ticks."""

    ambiguous: int = 0
    overspent: int = 0
    unsolved: int = 0
    late: int = 0
    jumps: int = 0


class CommandCounts(NamedTuple):
    """Counts that were last reported: messages refused, lost and without room, rows dropped, ticks refused, overdue."""

    refused: int = 0
    lost: int = 0
    full: int = 0
    dropped: int = 0
    ticks: int = 0
    overdue: int = 0


class Diagnosed(Protocol):
    """The part of a simulator that its diagnostics read: its state, its counts, and the counts last reported."""

    reported: TickCounts
    reported_commands: CommandCounts
    commands: CommandQueue
    feed: ViewerFeed | None
    intake: Intake
    lock: AbstractContextManager[Any]
    lock_step: bool
    margin: float | Undecided
    recorder: Any
    regularity: Regularity
    scene: Plan
    states: list[str]
    tick_clock: TickClock
    ticks: Ticks

    def get_fully_qualified_name(self) -> str:
        """Return the name of the node including its namespace."""

    def warn_once(self, text: str) -> None:
        """Log a warning unless the same one was logged before."""


def diagnose(node: Diagnosed) -> list[Status]:
    """Describe the status of the simulation, the commands, the recording and the viewer since the last call.

    Warnings concern events since then; counts concern the whole run.

    Args:
        node: the simulator.

    Returns:
        Level, name, message, hardware id and key-value pairs of each part.
    """
    states = {name: publishers_of(node, name) for name in node.states}
    commands = node.intake.find_publishers(node)
    me, hardware = node.get_fully_qualified_name().lstrip("/"), node.scene.name
    with node.lock:
        parts = {"simulation": _simulation(node, rivals_on_states(states)), "commands": _commands(node, commands)}
        if node.ticks.yields is not None:
            parts["actuators"] = (OK, *node.ticks.yields.report())
        if node.recorder is not None:
            recorder = node.recorder
            entries = [
                ("folder", str(recorder.folder)),
                ("messages", str(recorder.messages)),
                ("bytes waiting", str(recorder.waiting)),
            ]
            broken = recorder.problem
            parts["recording"] = ERROR if broken else OK, broken or "recording", entries
        if node.feed is not None:
            parts["viewer"] = _viewer(node.feed)
    return [(level, f"{me}: {part}", text, hardware, entries) for part, (level, text, entries) in parts.items()]


def _jumps(node: Diagnosed) -> list[tuple[Fact, str]]:
    """Write the jumps where the ground changes with place, and where bodies that turn lose their stability."""
    if not node.scene.ground.lets_go and node.scene.body.turning is None:
        return []
    return [(Fact.JUMPS, str(node.ticks.counts.jumps)), (Fact.JUMP_LOSS, f"{node.ticks.counts.jump_loss:.3e}")]


def _orientation(node: Diagnosed) -> list[tuple[Fact, str]]:
    """Write the orientation of a shape in the plane; if springs are vectors, the pose's orientation is the identity."""
    if node.scene.body.dimension == 1:
        return []
    if node.scene.body.turning is not None:
        return [(Fact.YAW, f"{node.ticks.crawler.yaw:.6g}")]
    angle = float(shape_orientation(node.scene.body.position, node.ticks.crawler.displacement))
    return [(Fact.ORIENTATION, f"{angle:.6g}")]


def _stability(node: Diagnosed) -> list[tuple[Fact, str]]:
    """Write how stable a body that turns is; below 0 a small deviation grows."""
    if node.scene.body.turning is None:
        return []
    return [
        (Fact.STABILITY, f"{node.ticks.crawler.stability_margin:.6g}"),
        (Fact.LEAST_STABILITY, f"{node.ticks.counts.stability:.6g}"),
    ]


def _inertia(node: Diagnosed) -> list[tuple[Fact, str]]:
    """Write the largest inertia number since the start or the last reset, if the scene has masses or weights."""
    if node.ticks.inertia is None:
        return []
    found = node.ticks.inertia.result()
    where = "nowhere"
    if found.contact is not None:
        where = f"{node.scene.body.name_of(found.contact)} at {found.time:.9f} s"
    means = "not to be predicted"
    if found.deviation is not None:
        means = f"{found.deviation[0]:.3e} (well damped) to {found.deviation[1]:.3e} (undamped)"
    return [
        (Fact.INERTIA, f"{found.number:.6g}"),
        (Fact.INERTIA_FOUND, where),
        (Fact.INERTIA_DEVIATION, means),
    ]


def _margin(margin: float | Undecided) -> list[tuple[Fact, str]]:
    if isinstance(margin, Undecided):
        return [(Fact.MARGIN, "not decided"), (Fact.UNDECIDED, margin.value)]
    return [(Fact.MARGIN, f"{margin:.3e}")]


def _pace(node: Diagnosed) -> list[tuple[Fact, str]]:
    """Write how fast simulated time passes and how far it lags; in lock-step no clock sets a pace."""
    if node.lock_step:
        return []
    wall_ns = time.monotonic_ns()
    return [
        (Fact.FACTOR, f"{node.tick_clock.achieved_factor(wall_ns):.6f}"),
        (Fact.LAG, f"{node.tick_clock.lag_ns(wall_ns) / NS:.6f}"),
    ]


def _late_times(tick_clock: TickClock) -> list[tuple[Fact, str]]:
    """Write when ticks were late, and the worst delay."""
    if tick_clock.late == 0:
        return []
    return [
        (Fact.FIRST_LATE, f"{tick_clock.first_late_ns / NS:.9f}"),
        (Fact.WORST_LATE, f"{tick_clock.worst_late_ns / NS:.9f}"),
        (Fact.WORST_DELAY, f"{tick_clock.worst_delay_ns / NS:.9f}"),
    ]


def _reasons(intake: Intake) -> Entries:
    """Write how many messages were refused for each reason, and when."""
    return [
        Refusal(reason.topic, reason.why, reason.count, reason.first_ns / NS, reason.last_ns / NS).entry()
        for reason in intake.refusals.reasons
    ]


def _simulation(node: Diagnosed, rival: str) -> Part:
    late, counts = node.tick_clock.late, node.ticks.counts
    level, message = OK, "waiting for commands" if node.lock_step and node.commands.is_idle else "ticking"
    before = node.reported
    node.reported = TickCounts(counts.ambiguous, counts.overspent, counts.unsolved, late, counts.jumps)
    finite, inaccurate = node.ticks.certificates.judge()
    if late > before.late:
        level = WARN
        message = f"{late - before.late} late tick(s): this machine cannot maintain the rate; simulated time lags"
    if node.scene.body.turning is not None and counts.jumps > before.jumps:
        where = "" if node.scene.ground.lets_go else " where stability was lost"
        message = f"{counts.jumps - before.jumps} jump(s){where}; where they end is a choice"
        level = WARN
    if counts.ambiguous > before.ambiguous:
        level, message = WARN, f"in some ticks {UNDETERMINED}"
    if counts.overspent > before.overspent:
        level, message = WARN, "some ticks exceeded the budget of work; catch-up steps completed them"
    if counts.unsolved > before.unsolved:
        level, message = WARN, "some ticks were not solved; see the largest violation"
    if inaccurate:
        level, message = WARN if finite else ERROR, inaccurate
    if rival:
        level, message = max(level, WARN), rival
        node.warn_once(rival)
    residual, violation, complementarity = (f"{v:.3e}" for v in node.ticks.certificates.worst)
    return (
        level,
        message,
        [
            (Fact.SIMULATED_TIME, f"{node.tick_clock.now_ns / NS:.9f}"),
            (Fact.TICKS, str(node.tick_clock.tick)),
            (Fact.LATE_TICKS, str(late)),
            *_pace(node),
            *_late_times(node.tick_clock),
            (Fact.LEAST_FRICTION, f"{node.regularity.least:.3e} ({node.regularity.where})"),
            *_margin(node.margin),
            (Fact.VISITED_MARGIN, f"{node.ticks.crawler.visited_margin:.3e}"),
            (Fact.AMBIGUOUS, str(counts.ambiguous)),
            (Fact.OVERSPENT, str(counts.overspent)),
            (Fact.UNSOLVED, str(counts.unsolved)),
            *_orientation(node),
            *_jumps(node),
            *_stability(node),
            *_inertia(node),
            (Fact.RESIDUAL, residual),
            (Fact.VIOLATION, violation),
            (Fact.COMPLEMENTARITY, complementarity),
        ],
    )


def _commands(node: Diagnosed, publishers: dict[str, list[tuple[bytes, str]]]) -> Part:
    intake, refused = node.intake, node.intake.refusals.total
    queue = node.commands
    now = CommandCounts(refused, intake.lost, queue.full, queue.unheld, node.ticks.counts.unheld, queue.overdue)
    before, node.reported_commands = node.reported_commands, now
    level, news = OK, []
    unheld = "no equilibrium holds their loads"
    if node.scene.body.turning is not None:
        frictions = "the frictions of a point do not fit together"
        unheld = f"{unheld}, or {frictions}" if node.scene.columns.loads else frictions
    if now.ticks > before.ticks:
        news.append(f"the commands of {now.ticks - before.ticks} tick(s) refused")
    if now.dropped > before.dropped:
        news.append(f"{now.dropped - before.dropped} row(s) dropped: {unheld}")
    if now.lost > before.lost:
        news.append(f"{now.lost - before.lost} message(s) lost: they arrived faster than they could be read")
    if now.overdue > before.overdue:
        news.append(
            f"{now.overdue - before.overdue} trajectory message(s) wholly in the past, followed within one tick"
        )
    rival = intake.find_rivals(publishers)
    if rival:
        news.append(rival)
        node.warn_once(rival)
    if refused:
        news.append(f"{refused} message(s) refused; last: {intake.refusals.last}")
    if rival or any(a > b for a, b in zip(now, before, strict=True)):
        level = WARN
    counts = intake.refusals.counts
    return (
        level,
        "; ".join(news) or "all accepted",
        [
            (Fact.REFUSED, str(refused)),
            (Fact.FULL, str(queue.full)),
            (Fact.OVERDUE, str(queue.overdue)),
            (Fact.ROWS_DROPPED, str(queue.unheld)),
            (Fact.TICKS_REFUSED, str(node.ticks.counts.unheld)),
            (Fact.LOST, str(intake.lost)),
            (Fact.WAITING, f"{queue.waiting} of {queue.most_waiting}"),
            *((f"received on {name}", str(a.received)) for name, a in intake.arrivals.items()),
            *((f"lost on {name}", str(a.lost)) for name, a in intake.arrivals.items() if a.lost),
            *((f"{REFUSED_ON}{name}", str(count)) for name, count in sorted(counts.items())),
            *_reasons(intake),
        ],
    )


def _viewer(feed: ViewerFeed) -> Part:
    message = f"{feed.dropped} frame(s) dropped: the viewer is slow" if feed.dropped else "viewing"
    if not feed.alive:
        message = "the viewer has ended"
    return WARN if feed.dropped or not feed.alive else OK, message, [("dropped", str(feed.dropped))]
