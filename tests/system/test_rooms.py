"""The arrows between the rooms: imports go down one list, which pyproject.toml has, and no files import in a circle."""

from __future__ import annotations

import grimp
from importlinter.cli import EXIT_STATUS_SUCCESS, lint_imports

from ..pages import ROOT

PACKAGES = ("crawler_lab", "crawler_command", "crawler_ros", "crawler_pictures", "crawler_model")
"""From the top down."""


def test_rooms_import_only_from_those_below(capsys):
    status = lint_imports(str(ROOT / "pyproject.toml"), no_cache=True)
    assert status == EXIT_STATUS_SUCCESS, capsys.readouterr().out


def test_no_files_import_in_a_circle():
    """Imports in functions and only for types count."""
    graph = grimp.build_graph(*PACKAGES, cache_dir=None)
    state: dict[str, int] = {}
    circles = []

    def visit(name: str, path: tuple[str, ...]) -> None:
        state[name] = 1
        for other in sorted(graph.find_modules_directly_imported_by(name)):
            if state.get(other) == 1:
                circles.append(" -> ".join((*path[path.index(other) :], other)))
            elif other not in state:
                visit(other, (*path, other))
        state[name] = 2

    for name in sorted(graph.modules):
        if name not in state:
            visit(name, (name,))
    assert len(state) > 300
    assert circles == []
