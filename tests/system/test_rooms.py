"""The arrows between the rooms: imports go down one list, never up, and no files import in a circle."""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent
PACKAGES = (
    "crawler_lab",
    "crawler_command",
    "crawler_ros",
    "crawler_pictures",
    "crawler_model",
)
"""From the top down; a package imports from those below it."""
ROOMS = {
    "crawler_lab": (
        "verbs",
        "verbs.identify",
        "play",
        "gym",
        "gym.kernel",
        "pictures",
        "identify",
        "identify.forecast",
        "identify.judge",
        "identify.fit",
        "identify.replica",
        "identify.sensor",
        "optimise",
        "derivative",
        "sweep",
    ),
    "crawler_command": ("many",),
    "crawler_ros": (
        "replay.show",
        "node",
        "node.life",
        "node.intake",
        "replay",
        "viewer",
        "recording",
        "wire",
        "examples",
    ),
    "crawler_pictures": ("film", "run"),
    "crawler_model": (
        "run",
        "scene",
        "crawler",
        "theory",
        "motion.line",
        "motion.line.critical",
        "motion.line.springs",
        "motion.line.ground",
        "motion.plane",
        "motion",
        "body",
    ),
}
"""In each package, from the top down. A folder and the folders inside it may import each other, but not in a circle."""


@functools.cache
def files() -> dict[str, Path]:
    """All modules of the project by name."""
    found = {}
    for package in PACKAGES:
        for file in (ROOT / package).rglob("*.py"):
            parts = file.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    return found


def imported(name: str) -> Iterator[str]:
    """The modules of the project that a module imports, at its top, in functions and for types alone."""
    file = files()[name]
    here = name.split(".") if file.name == "__init__.py" else name.split(".")[:-1]
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in files())
        elif isinstance(node, ast.ImportFrom):
            base = here[: len(here) - node.level + 1] if node.level else []
            source = ".".join([*base, *(node.module.split(".") if node.module else [])])
            for alias in node.names:
                inner = f"{source}.{alias.name}"
                if inner in files():
                    yield inner
                elif source in files():
                    yield source


@functools.cache
def arrows() -> dict[str, frozenset[str]]:
    return {name: frozenset(imported(name)) - {name} for name in files()}


def room(name: str) -> tuple[str, str]:
    """The package and the folder in it that a module lies in."""
    folder = files()[name].parent.relative_to(ROOT).parts
    return folder[0], ".".join(folder[1:])


def test_packages_import_only_from_those_below():
    up = [
        f"{name} -> {other}"
        for name, others in arrows().items()
        for other in others
        if PACKAGES.index(room(other)[0]) < PACKAGES.index(room(name)[0])
    ]
    assert up == []


@pytest.mark.parametrize("package", ROOMS)
def test_rooms_import_only_from_those_below(package):
    order = ROOMS[package]
    inside = [name for name in files() if room(name)[0] == package and room(name)[1]]
    assert {room(name)[1] for name in inside} == set(order)
    up = []
    for name in inside:
        for other in arrows()[name]:
            here, there = room(name)[1], room(other)[1]
            nested = f"{here}.".startswith(f"{there}.") or f"{there}.".startswith(f"{here}.")
            if room(other)[0] == package and there and not nested and order.index(there) < order.index(here):
                up.append(f"{name} -> {other}")
    assert up == []


def test_no_files_import_in_a_circle():
    """Imports in functions and for types alone count."""
    state: dict[str, int] = {}
    circles = []

    def visit(name: str, path: tuple[str, ...]) -> None:
        state[name] = 1
        for other in sorted(arrows()[name]):
            if state.get(other) == 1:
                circles.append(" -> ".join((*path[path.index(other) :], other)))
            elif other not in state:
                visit(other, (*path, other))
        state[name] = 2

    for name in sorted(files()):
        if name not in state:
            visit(name, (name,))
    assert circles == []
