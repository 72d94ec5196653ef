"""How often models that are wrong are called doubtful, and their cause is the first explanation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tests.lab.identify import mistakes

from .coverage import measure_each

ROBOTS, QUICK = 200, 1


def measure_mistakes(robots: int, progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """Identify robots that are not what they are taken for, in as many processes as there are cores.

    Returns:
        A row for each kind of mistake, see `summarise_mistake`.
    """
    found = measure_each(mistakes.KINDS, robots, judge_mistake, progress)
    return [summarise_mistake(kind, rows) for kind, rows in found.items()]


def judge_mistake(seed: int, kind: str) -> tuple[bool, bool]:
    """Identify a robot with a mistake.

    Args:
        seed: of the robot.
        kind: of the mistake.

    Returns:
        Whether it is called doubtful, and whether the right explanation is the first.
    """
    found, first = mistakes.identify_mistake(seed, kind)
    return not found.model_fits, first


def summarise_mistake(kind: str, rows: list[tuple[bool, bool]]) -> dict[str, Any]:
    """Write the row of a kind of mistake.

    Args:
        kind: of the mistake.
        rows: from `judge_mistake`.

    Returns:
        The number of robots, how many are called doubtful, and of how many of these the cause is the first explanation.
    """
    return {
        "case": "mistake",
        "mistake": kind,
        "robots": len(rows),
        "doubtful": sum(doubtful for doubtful, _ in rows),
        "first": sum(first for doubtful, first in rows if doubtful),
    }
