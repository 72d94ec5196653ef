"""The page of an optimal gait: keys have units, curves that coincide stay visible, ticks keep apart."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("cma")
from matplotlib.figure import Figure

from crawler_lab import Optimum, optimise
from crawler_lab.optimise.search import _STALE_ROUNDS
from crawler_lab.pictures.optimum import draw_optimum
from crawler_model import Scene, load_scene
from crawler_pictures.colors import LINES
from crawler_pictures.run.kymograph import place_legend
from crawler_pictures.style import Page, on_page

from ...golden_pictures import crowded_pictures

BODY = {"contacts": [0.0, 0.1, 0.2], "links": {"stiffness": 10.0}}


def draw(best: Optimum) -> Figure:
    kept: list[Figure] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", lambda figure, *_, **__: kept.append(figure))
        draw_optimum(best, dict.fromkeys(best.names, "m"), Path("not_written.png"))
    kept[0].canvas.draw()
    return kept[0]


@pytest.fixture(scope="module")
def best() -> Optimum:
    scene = Scene.model_validate({"name": "worm", "body": BODY, "friction": {"forward": 0.02, "backward": 0.06}})
    return optimise(scene, "translation", waypoints=2, stroke=(-0.01, 0.01), mapped=True)


@pytest.fixture(scope="module")
def figure(best) -> Figure:
    return draw(best)


def test_no_words_of_a_paper_leave_the_column_or_cover_each_other(best, tmp_path):
    with on_page(Page(paper=True)), crowded_pictures() as crowded:
        draw_optimum(best, dict.fromkeys(best.names, "m"), tmp_path / "x.pdf")
    assert crowded == []


def panel(figure: Figure, title: str):
    (axis,) = [axis for axis in figure.axes if axis.get_title("left").startswith(title)]
    return axis


def test_no_two_ticks_collide(figure):
    for axis in figure.axes:
        boxes = [label.get_window_extent() for label in axis.get_xticklabels() if label.get_text()]
        assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))


def test_a_long_key_ends_in_an_ellipsis():
    axis = Figure().subplots()
    place_legend(axis, axis.plot([0.0, 1.0], label="k" * 200))
    assert [text.get_text() for text in axis.get_legend().get_texts()] == ["k" * 55 + "..."]


def test_keys_have_units(figure):
    profiles, plane = panel(figure, "around the optimum (dots)"), panel(figure, "around the optimum (circle)")
    keys = [text.get_text() for text in profiles.get_legend().get_texts()]
    assert len(keys) == 4
    assert all(key.startswith("length of link_") and key.endswith(", \u22120.01 .. 0.01 m") for key in keys)
    assert plane.get_xlabel().endswith(" s [m]")
    assert plane.get_ylabel().endswith(" s [m]")


def test_the_legend_of_a_small_body_covers_nothing_beside_its_panel():
    small = {"contacts": [0.0, 1e-5], "links": {"stiffness": 10.0}}
    scene = Scene.model_validate({"name": "small", "body": small, "friction": {"forward": 2e-6, "backward": 5e-6}})
    axis = panel(draw(optimise(scene, "translation", waypoints=4, stroke=(0.0, 1e-6))), "around the optimum (dots)")
    assert len(axis.get_legend().get_texts()) == 4
    assert axis.get_legend().get_window_extent().x0 > axis.get_window_extent().x0


def test_the_circle_is_above_the_map_and_its_frame(figure):
    axis = panel(figure, "around the optimum (circle)")
    (circle,) = [line for line in axis.get_lines() if line.get_marker() == "o"]
    assert circle.get_zorder() > max(part.get_zorder() for part in (*axis.collections, *axis.spines.values()))


def test_curves_that_coincide_show_through_each_other(figure):
    lines = panel(figure, "around the optimum (dots)").get_lines()
    named = [line for line in lines if line.get_linestyle() != "None" and len(line.get_xdata()) > 2]
    assert [line.get_linestyle() for line in named] == ["-", "--", "-.", ":"]
    widths = [line.get_linewidth() for line in named]
    assert widths == sorted(widths, reverse=True)


def test_commands_and_motion_are_drawn_as_on_the_page_of_a_run(figure):
    commands, motion = panel(figure, "command: change of rest length"), panel(figure, "contacts over time")
    assert commands.get_legend().get_texts()
    assert [text.get_text() for text in motion.get_legend().get_texts()] == ["slips forward", "slips back", "sticks"]
    assert [text.get_text() for text in motion.texts] == ["0", "1", "2"]


def test_in_the_plane_two_periods_are_seen_from_above(monkeypatch):
    """The scissors turn about their hinge, the first point, by 0.76 rad a period."""
    monkeypatch.setitem(_STALE_ROUNDS, 2, 1)
    free = {"drive.actuation[1][2]": (0.0, 0.8)}
    figure = draw(optimise(load_scene("scissors"), "turn", free=free))
    above, profile = panel(figure, "from above"), panel(figure, "around the optimum (dots)")
    assert panel(figure, "command: change of rest angle")
    paths = {line.get_color(): line.get_xydata() for line in above.get_lines() if len(line.get_xydata()) == 121}
    hinge, left = paths[LINES[0]], paths[LINES[1]]
    assert np.ptp(hinge, axis=0).max() < 1e-6
    start, end = left[0] - hinge[0], left[-1] - hinge[-1]
    turned = np.arctan2(start[0] * end[1] - start[1] * end[0], start @ end)
    (curve,) = [line for line in profile.get_lines() if len(line.get_xdata()) > 2]
    assert curve.get_ydata()[-1] == pytest.approx(0.76, abs=1e-4)
    assert turned == pytest.approx(2.0 * float(profile.get_lines()[-1].get_ydata()[0]), abs=1e-4)
