"""Names that documentation imports stay importable, whatever room holds the code."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent
EARLIER = {
    "crawler_model.drive": "NS strategy_waypoints",
    "crawler_model.stasis": "Facet StasisDomain directions_of domain_evolution is_in_stasis section_forces spring_force "
    "stasis_bounds stasis_margins stasis_polygon tension_ranges",
    "crawler_model.uniqueness": "commanded_margin translation_interval uniqueness_margin visited_margin",
    "crawler_ros.body_picture": "draw_body draw_length",
    "crawler_ros.colors": "ACTUATION BACK CONTACTS FORWARD",
    "crawler_ros.domain_picture": "draw_domain",
    "crawler_ros.domain_polygon": "draw_box_in_space draw_polygon",
    "crawler_ros.domain_text": "STYLE friction_at",
    "crawler_ros.domain_two": "draw_band draw_box draw_motion draw_sweeping",
    "crawler_ros.replay": "Replay analyse simulate_again",
    "crawler_ros.replay.analysis": "Replay analyse simulate_again",
}
"""Modules that documentation named before the rooms, and the names that it imported from them."""
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


NAMES = sorted(documented() | {(module, name) for module, names in EARLIER.items() for name in names.split()})


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


@pytest.mark.parametrize("module", [module for module in EARLIER if "replay" not in module])
def test_earlier_modules_hold_no_code(module):
    """They import and name: nothing else."""
    tree = ast.parse((ROOT / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8"))
    docstring, *rest = tree.body
    assert isinstance(docstring, ast.Expr)
    assert all(isinstance(node, (ast.ImportFrom, ast.Assign)) for node in rest)
