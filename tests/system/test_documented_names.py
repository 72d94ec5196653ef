"""Names that documentation imports stay importable, whatever room holds the code."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path

import pytest

import crawler_lab
import crawler_model

ROOT = Path(__file__).parent.parent.parent
OPTIONAL = ("matplotlib", "mcap", "rosbags", "rclpy")


def documented() -> set[tuple[str, str]]:
    """Modules and names that pages and examples import from the packages."""
    sources = [file.read_text(encoding="utf-8") for file in sorted((ROOT / "examples").glob("*.py"))]
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))):
        sources += re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)
    return {
        (node.module, alias.name)
        for source in sources
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("crawler_")
        for alias in node.names
    }


NAMES = sorted(documented())


@pytest.mark.parametrize(("module", "name"), NAMES, ids=".".join)
def test_documented_names_are_importable(module, name):
    try:
        found = importlib.import_module(module)
    except ModuleNotFoundError as error:
        if str(error.name).split(".")[0] in OPTIONAL:
            pytest.skip(f"needs {error.name}")
        raise
    assert hasattr(found, name)


def test_pages_and_examples_are_read():
    assert {("crawler_model", "simulate"), ("crawler_ros.replay", "analyse")} <= documented()


@pytest.mark.parametrize("name", crawler_model._MOVED.split())
def test_names_of_the_first_release_are_found_with_a_warning(name):
    with pytest.warns(DeprecationWarning, match=f"from crawler_lab import {name}"):
        found = getattr(crawler_model, name)
    assert found is getattr(crawler_lab, name)
