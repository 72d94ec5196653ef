"""The contents of /diagnostics: the status of the simulation, the commands, the recording and the viewer."""

from __future__ import annotations

import time
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any, Protocol

from crawler_model.body.drive import NS
from crawler_model.run.orientation import shape_orientation

from .intake.peers import LENGTH_TOPICS, publishers_of, rivals_on_commands, rivals_on_states

if TYPE_CHECKING:  # the gait player needs none of the simulator's kernels
    from crawler_model import Crawler
    from crawler_model.body.plan import Plan
    from crawler_model.crawler.yields import YieldTimes
    from crawler_model.run.inertia import InertiaMeter
    from crawler_model.theory.regularity import Regularity

    from ..viewer.feed import ViewerFeed
    from .certificates import Certificates
    from .counts import Counts
    from .intake.commands import CommandQueue
    from .intake.intake import Intake
    from .stepper import Stepper

OK, WARN, ERROR = 0, 1, 2
Status = tuple[int, str, str, str, list[tuple[str, str]]]
Part = tuple[int, str, list[tuple[str, str]]]
"""Level, message and key-value pairs of one part of the node."""


class Diagnosed(Protocol):
    """The part of a simulator that its diagnostics read: its state, its counts, and the counts last reported."""

    counts: Counts
    reported: tuple[int, int, int, int, int]
    reported_commands: tuple[int, int, int, int, int]
    certificates: Certificates
    commands: CommandQueue
    crawler: Crawler
    feed: ViewerFeed | None
    inertia: InertiaMeter | None
    intake: Intake
    lock: AbstractContextManager[Any]
    lock_step: bool
    margin: float | None
    recorder: Any
    regularity: Regularity
    scene: Plan
    states: list[str]
    stepper: Stepper
    yields: YieldTimes | None

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
    commands = node.intake.settle(node)
    me, hardware = node.get_fully_qualified_name().lstrip("/"), node.scene.name
    with node.lock:
        parts = {"simulation": _simulation(node, rivals_on_states(states)), "commands": _commands(node, commands)}
        if node.yields is not None:
            parts["actuators"] = (OK, *node.yields.report())
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


def _jumps_and_refusals(node: Diagnosed) -> list[tuple[str, str]]:
    """Count jumps where the ground changes with place, and refused ticks there or where springs go slack."""
    patched, counts = node.scene.ground.track is not None, {}
    if patched:
        counts["jumps on patches of ground"] = node.counts.jumps
    if patched or node.scene.body.has_flat_springs:
        counts["ticks refused because nothing would hold the body"] = node.counts.unheld
    return [(key, str(count)) for key, count in counts.items()]


def _orientation(node: Diagnosed) -> list[tuple[str, str]]:
    """Write the orientation of a shape in the plane; if springs are vectors, that of the pose is the identity."""
    if node.scene.body.dimension == 1:
        return []
    if node.scene.body.turning is not None:
        return [("yaw [rad]", f"{node.crawler.yaw:.6g}")]
    angle = float(shape_orientation(node.scene.body.position, node.crawler.displacement))
    return [("orientation of the shape [rad]", f"{angle:.6g}")]


def _stability(node: Diagnosed) -> list[tuple[str, str]]:
    """Write how stable a body that turns is, and how often it jumped; below 0 a small deviation grows."""
    if node.scene.body.turning is None:
        return []
    return [
        ("stability margin", f"{node.crawler.stability_margin:.6g}"),
        ("least stability margin", f"{node.counts.stability:.6g}"),
        ("jumps where stability was lost", str(node.counts.jumps)),
        ("energy lost in jumps [J]", f"{node.counts.jump_loss:.3e}"),
        ("ticks refused because no stable equilibrium was found", str(node.counts.unheld)),
    ]


def _inertia(node: Diagnosed) -> list[tuple[str, str]]:
    """Write the largest inertia number since the start or the last reset, if the scene has masses or weights."""
    if node.inertia is None:
        return []
    found = node.inertia.result()
    where = "nowhere"
    if found.contact is not None:
        where = f"{node.scene.body.name_of(found.contact)} at {found.time:.9f} s"
    means = "not to be predicted"
    if found.deviation is not None:
        means = f"{found.deviation[0]:.3e} (well damped) to {found.deviation[1]:.3e} (undamped)"
    return [
        ("inertia number", f"{found.number:.6g}"),
        ("inertia number found", where),
        ("relative deviation of the gain by inertia", means),
    ]


def _pace(node: Diagnosed) -> list[tuple[str, str]]:
    """Write how fast simulated time passes and how far it lags; in lock-step no clock sets a pace."""
    if node.lock_step:
        return []
    wall_ns = time.monotonic_ns()
    return [
        ("real-time factor achieved", f"{node.stepper.achieved_factor(wall_ns):.6f}"),
        ("lag [s]", f"{node.stepper.lag_ns(wall_ns) / NS:.6f}"),
    ]


def _late_times(stepper: Stepper) -> list[tuple[str, str]]:
    """Write when ticks were late, and the worst delay."""
    if stepper.late == 0:
        return []
    return [
        ("first late tick at [s]", f"{stepper.first_late_ns / NS:.9f}"),
        ("worst late tick at [s]", f"{stepper.worst_late_ns / NS:.9f}"),
        ("worst late tick by [s]", f"{stepper.worst_delay_ns / NS:.9f}"),
    ]


def _reasons(intake: Intake) -> list[tuple[str, str]]:
    """Write how many messages were refused for each reason, and when: replay reads these entries."""
    return [
        (
            f"refused on {reason.topic}: {reason.why}",
            f"{reason.count}, first at {reason.first_ns / NS:.9f} s, last at {reason.last_ns / NS:.9f} s",
        )
        for reason in intake.refusals.reasons
    ]


def _simulation(node: Diagnosed, rival: str) -> Part:
    late, counts = node.stepper.late, node.counts
    level, message = OK, "waiting for commands" if node.lock_step and node.commands.is_idle else "ticking"
    before, node.reported = node.reported, (counts.ambiguous, counts.overspent, counts.unsolved, late, counts.jumps)
    finite, inaccurate = node.certificates.judge()
    if late > before[3]:
        level = WARN
        message = f"{late - before[3]} late tick(s): this machine cannot maintain the rate; simulated time lags"
    if node.scene.body.turning is not None and counts.jumps > before[4]:
        message = f"{counts.jumps - before[4]} jump(s) where stability was lost; where they end is a choice"
        level = WARN
    if counts.ambiguous > before[0]:
        level, message = WARN, "the translation was not determined in some ticks; the one nearest to zero was taken"
    if counts.overspent > before[1]:
        level, message = WARN, "some ticks exceeded the budget of work; catch-up steps completed them"
    if counts.unsolved > before[2]:
        level, message = WARN, "some ticks were not solved; see the largest violation"
    if inaccurate:
        level, message = WARN if finite else ERROR, inaccurate
    if rival:
        level, message = max(level, WARN), rival
        node.warn_once(rival)
    residual, violation, complementarity = (f"{v:.3e}" for v in node.certificates.worst)
    return (
        level,
        message,
        [
            ("simulated time [s]", f"{node.stepper.now_ns / NS:.9f}"),
            ("ticks", str(node.stepper.tick)),
            ("late ticks", str(late)),
            *_pace(node),
            *_late_times(node.stepper),
            ("least friction of the scene", f"{node.regularity.least:.3e} ({node.regularity.where})"),
            ("uniqueness margin", "not decided" if node.margin is None else f"{node.margin:.3e}"),
            ("visited margin", f"{node.crawler.visited_margin:.3e}"),
            ("ticks without a determined translation", str(counts.ambiguous)),
            ("ticks over the budget of work", str(counts.overspent)),
            ("ticks not solved", str(counts.unsolved)),
            *_orientation(node),
            *_jumps_and_refusals(node),
            *_stability(node),
            *_inertia(node),
            ("largest energy residual of a tick [J]", residual),
            ("largest violation of a bound [N]", violation),
            ("largest complementarity [J]", complementarity),
        ],
    )


def _commands(node: Diagnosed, publishers: dict[str, list[tuple[bytes, str]]]) -> Part:
    intake, refused = node.intake, node.intake.refusals.total
    now = refused, intake.lost, node.commands.full, node.commands.unheld, node.counts.unheld
    before, node.reported_commands = node.reported_commands, now
    level, news = OK, []
    unheld = "no equilibrium holds their loads"
    if node.scene.body.turning is not None:
        frictions = "the frictions of a point do not fit together"
        unheld = f"{unheld}, or {frictions}" if node.scene.columns.loads else frictions
    if node.counts.unheld > before[4]:
        news.append(f"the commands of {node.counts.unheld - before[4]} tick(s) refused")
    if node.commands.unheld > before[3]:
        news.append(f"{node.commands.unheld - before[3]} row(s) dropped: {unheld}")
    if intake.lost > before[1]:
        news.append(f"{intake.lost - before[1]} message(s) lost: they arrived faster than they could be read")
    rival = rivals_on_commands({name: publishers[name] for name in LENGTH_TOPICS})
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
            ("refused", str(refused)),
            ("refused because the queue was full", str(node.commands.full)),
            (f"dropped because {unheld}", str(node.commands.unheld)),
            ("ticks refused", str(node.counts.unheld)),
            ("lost", str(intake.lost)),
            ("rows waiting", f"{node.commands.waiting} of {node.commands.most_waiting}"),
            *((f"received on {name}", str(a.received)) for name, a in intake.arrivals.items()),
            *((f"lost on {name}", str(a.lost)) for name, a in intake.arrivals.items() if a.lost),
            *((f"refused on {name}", str(count)) for name, count in sorted(counts.items())),
            *_reasons(intake),
        ],
    )


def _viewer(feed: ViewerFeed) -> Part:
    message = f"{feed.dropped} frame(s) dropped: the viewer is slow" if feed.dropped else "viewing"
    if not feed.alive:
        message = "the viewer has ended"
    return WARN if feed.dropped or not feed.alive else OK, message, [("dropped", str(feed.dropped))]
