"""Pictures are drawn with matplotlib's own settings, whatever a user's matplotlibrc contains."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")
import matplotlib
from matplotlib import style
from PIL import Image

from crawler_lab import simulate_many, vary
from crawler_lab.pictures.sweep import draw_sweep
from crawler_model import load_scene, simulate
from crawler_pictures.domain import draw_domain
from crawler_pictures.film.film import film_of_run
from crawler_pictures.film.stage import Stage
from crawler_pictures.run.run_page import draw_run
from crawler_pictures.run.trajectory import read_trajectory
from crawler_pictures.style import own_style, rim_of

ROOT = Path(__file__).parents[3]
SETTINGS = (
    "text.usetex: True",
    "text.color: white",
    "text.parse_math: False",
    "text.antialiased: False",
    "font.family: serif",
    "font.size: 30",
    "mathtext.fontset: stix",
    "figure.figsize: 1, 1",
    "figure.dpi: 30",
    "figure.facecolor: black",
    "figure.autolayout: True",
    "figure.constrained_layout.use: True",
    "savefig.dpi: 300",
    "savefig.bbox: tight",
    "savefig.transparent: True",
    "savefig.facecolor: black",
    "savefig.format: svg",
    "axes.grid: True",
    "axes.facecolor: black",
    "axes.labelcolor: white",
    "axes.prop_cycle: cycler('color', ['black'])",
    "axes.unicode_minus: False",
    "axes.formatter.use_locale: True",
    "axes.spines.left: False",
    "lines.linewidth: 10",
    "lines.antialiased: False",
    "path.simplify: False",
    "path.sketch: 5, 100, 2",
    "legend.fontsize: 40",
    "image.cmap: gray",
    "xtick.labelsize: 30",
    "xtick.direction: in",
    "\n".join(f"{key}: {value}" for key, value in style.library["ggplot"].items() if key != "axes.prop_cycle"),
    "\n".join(f"{key}: {value}" for key, value in style.library["dark_background"].items() if "cycle" not in key),
)

GROUPS = 5
"""Each setting is in one of these groups, in which two never set the same to different values."""


@pytest.fixture(scope="module")
def drawn(tmp_path_factory) -> Callable[[], list[bytes]]:
    """Draw a picture of each kind; return their pixels."""
    file = tmp_path_factory.mktemp("drawn") / "drawn.png"
    two, wave = load_scene("two_anchor_a"), load_scene("ten_contact_wave")
    run, settled = simulate(wave, 2.0), simulate(wave, 0.1)
    variations = vary(wave, {"friction.forward": [0.1, 0.2], "body.links.stiffness": [1.0, 2.0]})
    many = simulate_many(variations, 0.1)
    film = film_of_run(wave, settled)

    def pixels() -> bytes:
        with Image.open(file) as picture:
            assert picture.format == "PNG"
            return repr(picture.size).encode() + picture.convert("RGBA").tobytes()

    def draw() -> list[bytes]:
        found = []
        for picture in (
            lambda: draw_domain(two, file),
            lambda: draw_run(read_trajectory(run), file),
            lambda: draw_sweep(variations, dict.fromkeys(variations.values, "1"), (), many, file),
        ):
            picture()
            found.append(pixels())
        with own_style():
            found.append(np.ascontiguousarray(Stage(film).draw(0)).tobytes())
        return found

    return draw


@pytest.fixture(scope="module")
def plain(drawn) -> list[bytes]:
    with matplotlib.rc_context(matplotlib.rcParamsDefault):
        return drawn()


@pytest.mark.parametrize("group", range(GROUPS))
def test_settings_of_the_user_change_no_bit_of_a_picture(group, drawn, plain, tmp_path):
    """Several settings at once, as a picture of each would take a minute; where pixels differ, one by one."""

    def changes(*settings: str) -> bool:
        (tmp_path / "matplotlibrc").write_text("\n".join(settings))
        with matplotlib.rc_context(fname=tmp_path / "matplotlibrc"):
            return drawn() != plain

    settings = SETTINGS[group::GROUPS]
    if changes(*settings):
        pytest.fail(f"pixels change with {[one for one in settings if changes(one)] or settings}")


def test_a_matplotlibrc_with_a_foreign_backend_changes_no_bit(tmp_path):
    pictures = []
    for name, lines in (("default", []), ("user", ["backend: svg", "text.usetex: True", "figure.figsize: 1, 1"])):
        (tmp_path / name).write_text("\n".join(lines))
        words = [
            sys.executable,
            "-m",
            "crawler_command.app",
            "check",
            "two_anchor_a",
            "--png",
            tmp_path / f"{name}.png",
        ]
        environment = os.environ | {"MATPLOTLIBRC": str(tmp_path / name)}
        done = subprocess.run(words, env=environment, capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, "")
        pictures.append((tmp_path / f"{name}.png").read_bytes())
    assert pictures[0] == pictures[1]


def test_settings_of_the_user_hold_again_behind_a_picture():
    with matplotlib.rc_context({"font.size": 23, "text.color": "white"}):
        with own_style({"font.size": 9}):
            assert (matplotlib.rcParams["font.size"], matplotlib.rcParams["text.color"]) == (9, "black")
        assert (matplotlib.rcParams["font.size"], matplotlib.rcParams["text.color"]) == (23, "white")


OPENING = {"Figure", "open_figure", "figure", "Stage"}
HELPERS = {"draw_two", "draw_three", "draw_many", "draw_panels", "open_figure"}
"""Build figures for `draw_domain` and others, with their settings."""


def test_every_function_that_opens_a_figure_does_so_with_these_settings():
    checked = []
    for package in ("crawler_pictures", "crawler_ros", "crawler_lab", "crawler_command", "benchmarks"):
        for file in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if isinstance(node, ast.FunctionDef) and called(node) & OPENING and node.name not in HELPERS:
                    assert "own_style" in called(node), f"{file.relative_to(ROOT)}: {node.name}"
                    checked.append(node.name)
    assert len(checked) >= 14


def called(node: ast.FunctionDef) -> set[str]:
    """The names of what a function calls, its decorators included."""
    calls = [n.func for n in ast.walk(node) if isinstance(n, ast.Call)]
    return {getattr(call, "attr", getattr(call, "id", "")) for call in calls}


def test_of_lines_that_are_equal_each_is_seen():
    for count in (2, 4):
        widths = [rim_of(k, count) for k in range(count)]
        assert widths == sorted(set(widths), reverse=True)
        assert widths[-1] == 0.0
