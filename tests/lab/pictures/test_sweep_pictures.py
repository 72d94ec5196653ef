"""The pictures of sweeps: the column that is asked for, and gaps between values that stay open."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")
from matplotlib.figure import Figure
from PIL import Image

from crawler_lab import simulate_many, vary
from crawler_lab.pictures.sweep import draw_sweep, find_gaps, find_jumps, shown_column
from crawler_lab.sweep.results import name_numbers
from crawler_model import CrawlerError, load_scene

UNITS = {"drive.wave.wavelength": "m", "drive.wave.amplitude": "m"}


def wave_of_both_signs():
    plain = load_scene("ten_contact_wave").document()
    plain["start"] = "relaxed"
    scene = type(load_scene("ten_contact_wave")).model_validate(plain)
    lengths = np.array([-0.8, -0.6, -0.4, 0.4, 0.6, 0.8])
    return vary(scene, {"drive.wave.wavelength": lengths, "drive.wave.amplitude": [0.01, 0.02]})


def test_gaps_are_found_where_a_grid_is_left_out():
    assert find_gaps(np.array([-0.8, -0.6, -0.4, 0.4, 0.6])).tolist() == [False, False, True, False]
    assert not find_gaps(np.log(np.geomspace(1.0, 100.0, 7))).any()
    assert not find_gaps(np.array([2.0])).any()


def test_a_map_stays_open_between_wavelengths_of_both_signs_and_shows_the_column(tmp_path):
    variations = wave_of_both_signs()
    runs = simulate_many(variations, duration=2.0, workers=1)
    pictures = []
    for column in (None, "work"):
        draw_sweep(variations, UNITS, [], runs, tmp_path / "x.png", column)
        pictures.append(np.asarray(Image.open(tmp_path / "x.png").convert("RGB")).astype(int))
    grey = (np.abs(pictures[0] - 0xD8).max(axis=2) < 3).sum(axis=0)
    middle = np.flatnonzero(grey > 0.5 * grey.max())  # the band of no wavelength
    assert np.ptp(middle) + 1 == pytest.approx(middle.size, abs=2)
    assert middle.size == pytest.approx(0.6 / 1.8 * 660, abs=40)
    assert np.abs(pictures[0] - pictures[1]).mean() > 2.0
    assert shown_column(runs, "work")[1] == pytest.approx(runs.work)


@pytest.mark.parametrize("name", ["two_anchor_a", "planar_rectilinear", "scissors"])
def test_a_picture_shows_each_number_of_the_table(name):
    scene = load_scene(name)
    runs = simulate_many([scene], duration=2.0 * scene.drive.period, rate=8.0, workers=1)
    table = runs.to_table()
    numbers = [column for column in table.column_names if column not in ("status", "reason")]
    assert list(name_numbers(scene)) == numbers
    for column in numbers:
        shown = table[column][0].as_py()
        if shown is not None:
            assert shown_column(runs, column)[1] == pytest.approx([float(shown)])


def test_a_column_without_values_is_refused():
    runs = simulate_many(vary(load_scene("two_anchor_a"), {"drive.length": [1.0, 2.0]}), duration=0.5, workers=1)
    with pytest.raises(CrawlerError, match="--plot: no variation has a value of per_period"):
        shown_column(runs, "per_period")


def test_a_map_tells_runs_without_a_value_from_those_that_did_not_run(monkeypatch):
    """Short strokes do not travel, so that there is no cost of transport; a stiffness of 0 is no scene."""
    axes = {"drive.length": [0.5, 4.0, 6.0], "body.links.stiffness": [0.0, 1.0]}
    variations, kept, said = vary(load_scene("two_anchor_a"), axes), [], []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: kept.append(figure))
    runs = simulate_many(variations, duration=3.0, workers=1)
    runs = (runs, dataclasses.replace(runs, status=np.full(6, "done")))
    for one in runs:
        draw_sweep(variations, dict.fromkeys(axes, "m"), [], one, Path("not_written.png"), "cost_of_transport")
        said += [text.get_text() for text in kept[-1].axes[0].get_legend().get_texts()]
    assert [text for text in said if "value" in text] == ["no value, invalid or not run", "no value"]


def test_jumps_are_steps_that_neither_neighbour_continues():
    assert find_jumps(np.array([0.0, 0.0, 1.0, 1.0])).tolist() == [False, True, False]
    assert find_jumps(np.array([0.0, 0.5, 1.0, 0.5, 0.0])).tolist() == [False] * 4  # a kink is no jump
    assert find_jumps(np.array([0.0, 0.3, 1.3, 2.3, 2.3])).tolist() == [False] * 4  # nor is the foot of a slope
    assert find_jumps(np.array([1.0, 1.1, 0.2, 1.2, 0.1, 0.2])).tolist() == [False, True, True, True, False]
    assert find_jumps(np.array([0.0, 0.0, np.nan, 1.0])).tolist() == [False] * 3
    assert find_jumps(np.array([2.0])).tolist() == []


@pytest.mark.parametrize("count", [26, 25])  # with a sample where both are equal, and without
def test_a_line_is_not_joined_across_a_jump(count, monkeypatch):
    """Two contacts go where friction is less: the gain changes sign where both are equal."""
    variations = vary(load_scene("two_contacts_anisotropic"), {"friction.backward": np.linspace(0.1, 0.35, count)})
    runs = simulate_many(variations, duration=2.0, workers=1)
    kept: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: kept.append(figure))
    draw_sweep(variations, {"friction.backward": "N"}, [], runs, Path("not_written.png"))
    _, line, *_ = kept[0].axes[0].get_lines()
    y = line.get_ydata()
    assert np.nanmin(y) < -0.05
    assert np.nanmax(y) > 0.05
    assert (np.ma.masked_invalid(np.abs(np.diff(y))) < 0.05).all()
