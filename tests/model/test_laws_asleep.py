"""The laws, over chains whose contacts fall asleep as soon as two of them slide side by side: sleeping runs obey them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from crawler_model.motion.line import build

from . import test_laws


def variants(test: Any) -> list[tuple[str, str]]:
    """The kinds of bodies and methods that a law is tested with."""
    marks = [mark for mark in getattr(test, "pytestmark", []) if mark.args and mark.args[0] == ("kind", "method")]
    return [tuple(variant) for mark in marks for variant in mark.args[1]]


KINDS = [("chain", "exact"), ("segment", "exact")]
LAWS = [
    pytest.param(test, *variant, id=f"{name[5:]}-{variant[0]}")
    for name, test in vars(test_laws).items()
    if name.startswith("test_")
    for variant in KINDS
    if variant in variants(test)
]


@pytest.fixture(scope="module", autouse=True)
def asleep() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (("LONG", 2), ("FAN", 2), ("SHORTEST_BLOCK", 2)):
            patch.setattr(build, name, value)
        yield


@pytest.mark.parametrize(("law", "kind", "method"), LAWS)
def test_sleeping_runs_obey(law: Callable[..., None], kind: str, method: str) -> None:
    law(kind=kind, method=method)


def test_there_are_laws() -> None:
    assert len(LAWS) >= 8
