"""What /diagnostics says of a simulator: how the simulation, the commands, the recording and the viewer fare."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from crawler_model.drive import NS

if TYPE_CHECKING:
    from .simulator import Simulator

OK, WARN, ERROR = 0, 1, 2
Status = tuple[int, str, str, str, list[tuple[str, str]]]


def diagnose(node: Simulator) -> list[Status]:
    """Say how the simulation, the commands, the recording and the viewer fare since this was last asked.

    Warnings are of what happened since then; counts are of the whole run.

    Args:
        node: the simulator.

    Returns:
        Level, name, message, hardware id and key-value pairs of each.
    """
    me, hardware = node.get_fully_qualified_name().lstrip("/"), node.scene.name
    late, refused = node.stepper.late, node.refusals.total
    now = node.crawler.visited_margin
    level, message = OK, "waiting for commands" if node.lock_step and node.commands.is_idle else "ticking"
    before, node.reported = node.reported, (node.ambiguous, node.overspent, node.unsolved, late, refused)
    if late > before[3]:
        level = WARN
        message = f"{late - before[3]} late tick(s): this machine cannot keep the rate; simulated time slows"
    if node.ambiguous > before[0]:
        level, message = WARN, "translation not determined now; the one nearest to zero is taken"
    if node.overspent > before[1]:
        level, message = WARN, "the budget of events is spent in some ticks now; a catch-up step does the rest"
    if node.unsolved > before[2]:
        level, message = WARN, "some ticks are not solved now: the active set gave up, see the violation"
    if not np.isfinite(node.certificate).all():
        level, message = ERROR, "a tick's certificate is not finite: the commands are beyond what doubles can hold"
    if node.count_publishers("joint_states") > 1:
        level, message = WARN, "another node publishes joint_states here: two crawlers need two namespaces"
    residual, violation, complementarity = (f"{v:.3e}" for v in node.certificate)
    simulation = [
        ("simulated time [s]", f"{node.stepper.now_ns / NS:.9f}"),
        ("ticks", str(node.stepper.tick)),
        ("late ticks", str(late)),
        ("least friction of the scene", f"{node.regularity.least:.3e} ({node.regularity.where})"),
        ("uniqueness margin", "not decided" if node.margin is None else f"{node.margin:.3e}"),
        ("visited margin", f"{now:.3e}"),
        ("ticks without a determined translation", str(node.ambiguous)),
        ("ticks over the budget of events", str(node.overspent)),
        ("ticks not solved", str(node.unsolved)),
        ("largest energy residual of a tick [J]", residual),
        ("largest violation of a bound [N]", violation),
        ("largest complementarity [J]", complementarity),
    ]
    statuses = [(level, f"{me}: simulation", message, hardware, simulation)]
    counts = [(f"refused on {name}", str(count)) for name, count in sorted(node.refusals.counts.items())]
    message = f"{refused} message(s) refused; last: {node.refusals.last}" if refused else "all accepted"
    level = WARN if refused > before[4] else OK
    statuses.append((level, f"{me}: commands", message, hardware, [("refused", str(refused)), *counts]))
    if node.recorder is not None:
        recorder = node.recorder
        entries = [
            ("folder", str(recorder.folder)),
            ("messages", str(recorder.messages)),
            ("bytes waiting", str(recorder.waiting)),
        ]
        broken = recorder.problem
        statuses.append((ERROR if broken else OK, f"{me}: recording", broken or "recording", hardware, entries))
    if node.feed is not None:
        dropped = node.feed.dropped
        message = f"{dropped} frame(s) dropped: the viewer is slow" if dropped else "viewing"
        if not node.feed.alive:
            message = "the viewer has ended"
        statuses.append(
            (
                WARN if dropped or not node.feed.alive else OK,
                f"{me}: viewer",
                message,
                hardware,
                [("dropped", str(dropped))],
            )
        )
    return statuses
