"""docs/model.md and errata.md: their Python blocks, which tests/system/test_docs.py runs, assert what they say."""

from __future__ import annotations

import ast
import re

from crawler_model import gallery

from ..pages import ROOT, blocks

TEXTS = {name: (ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("model.md", "errata.md")}


def scenes():
    table = TEXTS["model.md"].split("\n## 7.")[1]
    rows = [line.split("|") for line in table.splitlines() if line.startswith("| ")][1:]
    return [re.fullmatch(r"\s*`(\w+)`\s*", row[2]) for row in rows if not row[1].startswith(" ---")]


def test_every_python_block_asserts_something():
    code = [block for page in TEXTS.items() for block in blocks(*page) if block.language == "python"]
    assert len(code) >= 10
    for block in code:
        assert any(isinstance(node, ast.Assert) for node in ast.walk(ast.parse(block.text))), block.place


def test_scenes_of_the_table_exist():
    named = scenes()
    assert len(named) > 10
    assert all(named)
    assert {match.group(1) for match in named} <= set(gallery())
