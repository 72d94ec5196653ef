"""The picture of an identification: residuals over time and over the phase of the commands, with and without misfit."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

pytest.importorskip("matplotlib")
from PIL import Image

from crawler_lab import Identification, identify
from crawler_lab.identify.measurements import Measurements
from crawler_lab.pictures.identification import draw_identification, plot_identification
from crawler_model import Scene, simulate
from crawler_pictures.style import Page, on_page

from ...golden_pictures import crowded_pictures

NOISE = 2e-4
BODY = {
    "name": "measured",
    "body": {"contacts": [0.0, 0.1, 0.2], "links": {"stiffness": [20.0, 23.0]}},
    "friction": {"forward": [0.2, 0.23, 0.26], "backward": [0.62, 0.55, 0.62]},
}


def record(stuck: bool = False, repeats: bool = True) -> Measurements:
    """Six periods of 1 s; a stuck link keeps its length for the last third of the fitted rows."""
    count = 8 * 6 + 1
    turn = 2.0 * np.pi * np.arange(count)[:, None] / 8.0 + np.array([0.0, 2.0])
    rows = 0.04 * np.sin(turn) if repeats else np.random.default_rng(0).uniform(-0.06, 0.06, (count, 2))
    rows = rows - rows[0]
    times, moved = np.arange(count) / 8.0, rows.copy()
    if stuck:
        moved[28:, 1] = moved[28, 1]
    scene = Scene.model_validate(BODY | {"drive": {"times": times.tolist(), "actuation": moved.tolist()}})
    run = simulate(scene, 6.0, 50.0)
    values = scene.body.position + run.displacement
    values = values + NOISE * np.random.default_rng(1).normal(size=values.shape)
    names = tuple(f"contact_{i}" for i in range(3))
    return Measurements("run", run.time, names, values, ("link_0", "link_1"), rows, times)


def fit(*recordings: Measurements) -> Identification:
    return identify(Scene.model_validate(BODY), recordings, ["friction.forward"], starts=1, seconds=0.0)


@pytest.fixture(scope="module")
def found():
    return {"noise": fit(record()), "stuck": fit(record(stuck=True))}


@pytest.mark.parametrize("name", ["noise", "stuck"])
def test_no_words_of_a_paper_leave_the_column_or_cover_each_other(found, name, tmp_path):
    with on_page(Page(paper=True)), crowded_pictures() as crowded:
        draw_identification(found[name], tmp_path / "x.pdf")
    assert crowded == []


def panels(found: Identification) -> tuple[list, list]:
    """The axes of residuals over time, and over phase."""
    axes = [axis for part in plot_identification(found).subfigs for axis in part.axes]
    rows = [axis for axis in axes if axis.get_ylabel().endswith("x noise")]
    return rows, [axes[axes.index(axis) + 1] for axis in rows]


def mean_curve(axis) -> np.ndarray:
    (line,) = [line for line in axis.lines if line.get_path_effects()]
    return np.asarray(line.get_ydata())


def test_each_contact_has_a_row_with_the_size_of_its_misfit(found):
    rows, _ = panels(found["stuck"])
    assert [axis.get_ylabel() for axis in rows] == [
        f"{one.channel}\n{one.ratio:.3g} x noise" for one in found["stuck"].misfits
    ]


def test_means_over_the_phase_leave_the_band_of_the_noise_only_with_a_misfit(found):
    largest = {}
    for kind, one in found.items():
        _, phases = panels(one)
        assert all(axis.get_xlim() == (0.0, 1.0) for axis in phases)
        largest[kind] = max(float(np.nanmax(np.abs(mean_curve(axis)))) for axis in phases)
    assert largest["noise"] < 1e3 * NOISE
    assert largest["stuck"] > 5e3 * NOISE


def test_the_time_from_which_a_misfit_shows_is_marked(found):
    for kind, expected in (("noise", 0), ("stuck", sum(m.since is not None for m in found["stuck"].misfits))):
        rows, _ = panels(found[kind])
        marks = [line for axis in rows for line in axis.lines if line.get_linestyle() == "--"]
        assert len(marks) == expected


def test_the_band_over_held_out_rows_is_that_of_their_predicted_deviations(found):
    one = found["stuck"]
    (rows, _), out = panels(one), ~one.fitted[0]
    time, deviation = one.recordings[0].time, one.score.deviations[0]
    for m, axis in enumerate(rows):
        (band,) = [c for c in axis.collections if len(c.get_paths()[0].vertices) > 2 * time.size - 1]
        at, high = band.get_paths()[0].vertices.T
        for k in np.flatnonzero(out)[::20]:
            assert high[at == time[k]].max() == pytest.approx(1.96e3 * deviation[k, m])


def test_commands_that_do_not_repeat_are_drawn_over_position():
    _, phases = panels(fit(record(repeats=False)))
    assert phases[-1].get_xlabel().startswith("way from the first position, mm")
    assert np.diff(phases[0].get_xlim())[0] > 10.0


def test_a_picture_of_several_recordings_with_gaps_shows_all_that_was_measured(tmp_path):
    first, second = record(), dataclasses.replace(record(), name="with gaps")
    values = second.values.copy()
    values[100:150] = np.nan
    values[::7, 0] = np.nan
    one = fit(first, dataclasses.replace(second, values=values))
    rows, _ = panels(one)
    assert len(rows) == 6
    for axis, column in zip(rows[3:], values.T, strict=True):
        assert np.isfinite(axis.lines[0].get_ydata()).sum() == np.isfinite(column).sum()
    draw_identification(one, tmp_path / "x.png")
    picture = np.asarray(Image.open(tmp_path / "x.png").convert("L"))
    assert (picture < 250).mean() > 0.05


def test_recordings_of_one_name_keep_their_own_misfits():
    rows, _ = panels(fit(record(), record(stuck=True)))
    sizes = [float(axis.get_ylabel().split("\n")[1].split()[0]) for axis in rows]
    assert max(sizes[3:]) > 3.0 * max(sizes[:3])
    assert len(rows) == 6


def test_of_many_recordings_those_with_the_largest_residuals_are_drawn(found):
    kinds = ["noise", "stuck", *["noise"] * 5, "stuck"]
    fields = {
        name: tuple(one for kind in kinds for one in getattr(found[kind], name))
        for name in ("recordings", "residuals", "fitted", "noises", "misfits")
    }
    figure = plot_identification(dataclasses.replace(found["noise"], score=None, **fields))
    assert len(figure.subfigs) == 6
    assert "6 of 8 recordings" in figure.subfigs[0]._suptitle.get_text()
    largest = [
        any(float(a.get_ylabel().split()[1]) > 5.0 for a in part.axes if "noise" in a.get_ylabel())
        for part in figure.subfigs
    ]
    assert sum(largest) == 2
