"""docs/model.md: its Python blocks hold as they stand there, and its scenes exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from crawler_model import gallery

TEXT = (Path(__file__).parent.parent.parent / "docs" / "model.md").read_text(encoding="utf-8")


def blocks():
    found = []
    for block in re.finditer(r"^```python\n(.*?)^```$", TEXT, re.S | re.M):
        line = TEXT.count("\n", 0, block.start(1))
        found.append(pytest.param(line, block.group(1), id=f"line_{line + 1}"))
    return found


def scenes():
    table = TEXT.split("\n## 7.")[1]
    rows = [line.split("|") for line in table.splitlines() if line.startswith("| ")][1:]
    return [re.fullmatch(r"\s*`(\w+)`\s*", row[2]) for row in rows if not row[1].startswith(" ---")]


@pytest.mark.parametrize(("line", "code"), blocks())
def test_block_runs(line, code):
    assert "assert " in code
    exec(compile("\n" * line + code, "docs/model.md", "exec"), {"__name__": "model"})


def test_every_python_block_is_found():
    assert len(blocks()) == TEXT.count("```python") >= 10


def test_scenes_of_the_table_exist():
    named = scenes()
    assert len(named) > 10
    assert all(named)
    assert {match.group(1) for match in named} <= set(gallery())
