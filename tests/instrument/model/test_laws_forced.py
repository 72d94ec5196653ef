"""The laws, through what is special to long bodies or rare: thresholds are forced down so that small bodies enter it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from crawler_model.motion.line import build_records

from . import test_laws

FORCED = {
    "asleep": {"LONG": 2, "LEAF_SIZE": 2, "SHORTEST_BLOCK": 2},  # two contacts that slide side by side fall asleep
    "projected": {"PROJECTS_AFTER": 0},  # every search for sides on a path begins with a projection
    "one_by_one": {"PATIENCE": 0},  # every search exchanges contacts one by one, and steps are divided
    "few": {"FEW_CONTACTS": 0},  # critical states are looked for only where rates are new, margins where ramps end
    "knots": {"TOGETHER": 0, "TURNS": 0},  # springs pass knots one after another, by Murty's rule
}
SLEEPERS = [("chain", "exact"), ("segment", "exact")]
KINDS = ("chain", "graph", "chain on patches", "graph on patches")
BENT = ("bent chain", "bent graph", "bent chain on patches")


def variants(test: Any) -> list[tuple[str, str]]:
    """The kinds of bodies and methods that a law is tested with."""
    marks = [mark for mark in getattr(test, "pytestmark", []) if mark.args and mark.args[0] == ("kind", "method")]
    return [tuple(variant) for mark in marks for variant in mark.args[1]]


LAWS = [
    pytest.param(test, forced, *variant, id=f"{forced}-{name[5:]}-{'-'.join(variant)}")
    for name, test in vars(test_laws).items()
    if name.startswith("test_")
    for variant in variants(test)
    for forced in FORCED
    if (variant in SLEEPERS if forced == "asleep" else variant[0] in (BENT if forced in ("few", "knots") else KINDS))
]


@pytest.mark.parametrize(("law", "forced", "kind", "method"), LAWS)
def test_it_is_obeyed(
    monkeypatch: pytest.MonkeyPatch, law: Callable[..., None], forced: str, kind: str, method: str
) -> None:
    for name, value in FORCED[forced].items():
        monkeypatch.setattr(build_records, name, value)
    law(kind=kind, method=method)


def test_there_are_laws() -> None:
    assert len(LAWS) >= 100
