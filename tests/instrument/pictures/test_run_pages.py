"""The page of a run for bodies of every kind, compared with pages that were looked at."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")
from matplotlib import pyplot as plt
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

from crawler_command.app import main
from crawler_model import CrawlerError, Scene, load_scene, simulate
from crawler_pictures.colors import LINES
from crawler_pictures.run.plane import draw_friction, draw_plane
from crawler_pictures.run.run_page import draw_run
from crawler_pictures.run.trajectory import read_trajectory

from ...golden_pictures import GOLDEN, TOLERANCE, differences, distance, words_of_figures


def waving(count: int, wavelength: float, friction: float) -> Scene:
    """A chain with a wave that travels forward."""
    return Scene.model_validate(
        {
            "name": f"{count}_contacts",
            "body": {"contacts": np.linspace(0.0, 1.0, count).tolist(), "links": {"stiffness": float(count)}},
            "start": "relaxed",
            "friction": {"forward": friction, "backward": 3.0 * friction},
            "drive": {"wave": {"amplitude": 0.3 / count, "wavelength": wavelength, "period": 1.0, "samples": 32}},
        }
    )


def star(count: int = 5, friction: Sequence[float] = (0.05, 0.05, 0.05, 0.1, 0.1, 0.1)) -> Scene:
    """Legs around a hub, in the plane: each is shortened and lengthened along itself."""
    angle = 0.5 * np.pi + 2.0 * np.pi * np.arange(count) / count
    legs = np.column_stack((np.cos(angle), np.sin(angle))).round(6)
    stroke = 0.15 * np.sin(np.pi * (np.arange(10)[:, None] / 5.0 - np.arange(count) * 2.0 / count)) ** 2
    rows = (stroke[..., None] * legs).round(9)
    return Scene.model_validate(
        {
            "name": "star",
            "dimension": 2,
            "start": "relaxed",
            "body": {
                "contacts": [[0.0, 0.0], *legs.tolist()],
                "links": {"stiffness": 5.0, "between": [[0, i] for i in range(1, count + 1)]},
            },
            "friction": {"isotropic": list(friction)},
            "drive": {"times": np.linspace(0.0, 0.9, 10).tolist(), "period": 1.0, "actuation": rows.tolist()},
        }
    )


def on_ice() -> Scene:
    """A chain of five contacts that walks onto a patch."""
    document = waving(5, 1.0, 0.1).document() | {"ground": {"patches": [{"from": 1.05, "to": 1.3, "friction": 0.3}]}}
    return Scene.model_validate(document)


def words_on_page(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> str:
    """All that is written on the page of three seconds of a scene, in lines."""
    kept: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: kept.append(figure))
    draw_run(read_trajectory(simulate(scene, 3.0)), Path("not_written.png"))
    return "\n".join(text.get_text() for text in kept[0].findobj(Text))


PAGES = {
    "three": lambda: load_scene("three_contacts_two_ways"),
    "six": lambda: waving(6, 1.0, 0.05),
    "ten": lambda: load_scene("ten_contact_wave"),
    "thousand": lambda: waving(1000, 0.5, 0.0003),
    "segment": lambda: load_scene("peristaltic_segment"),
    "hybrid": lambda: load_scene("hybrid_body"),
    "plane": lambda: load_scene("planar_three_points"),
}
WORDS = PAGES | {"a_colour_each": lambda: star(len(LINES) - 1, np.linspace(0.05, 0.1, len(LINES)).tolist())}
"""Pages whose words and curves are compared, also where their pictures are not."""


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    folder, drawn = tmp_path_factory.mktemp("pages"), {}

    def draw(name: str) -> Path:
        if name not in drawn:
            drawn[name] = folder / f"{name}.png"
            with words_of_figures() as words:
                draw_run(read_trajectory(simulate(WORDS[name](), 3.0)), drawn[name])
            drawn[name].with_suffix(".txt").write_text(words[0], "utf-8")
        return drawn[name]

    return draw


@pytest.mark.parametrize("name", PAGES)
def test_the_page_is_the_one_that_was_looked_at(pages, name):
    assert distance(pages(name), GOLDEN / f"run_{name}.png") < TOLERANCE


@pytest.mark.parametrize("name", WORDS)
def test_its_words_and_curves_are_those_that_were_read(pages, name):
    assert not differences(pages(name).with_suffix(".txt").read_text("utf-8"), GOLDEN / f"run_{name}.txt")


@pytest.mark.parametrize("name", ["planar_three_points", "planar_rectilinear", "loaded"])
def test_forces_in_the_plane_are_on_the_border_of_friction_where_a_contact_slides(name):
    if name == "loaded":
        document = load_scene("planar_three_points").document()
        document["ground"] = {"slope": 5.0}
        document["body"]["weights"] = 0.1
        document["loads"] = [[0.0, 0.05], [0.0, 0.0], [0.02, 0.0]]
        scene = Scene.model_validate(document)
    else:
        scene = load_scene(name)
    run = read_trajectory(simulate(scene, 3.0))
    normals = scene.drive.columns.directions
    first = scene.columns.lengths
    bounds = scene.drive.rows[0, first : first + scene.columns.frictions].reshape(run.force.shape[1], -1)
    size = np.linalg.norm(run.force, axis=2)[..., None] if normals.size == 0 else run.force @ normals.T
    room = (bounds - size).min(axis=2)
    assert room.min() > -1e-6
    assert np.abs(room[run.state != 0]).max() < 1e-6
    assert room[run.state == 0].max() > 0.05


def test_a_wave_that_travels_back_is_told_from_it(tmp_path):
    document = load_scene("ten_contact_wave").document()
    document["drive"]["wave"]["wavelength"] *= -1.0
    document["start"] = "relaxed"
    draw_run(read_trajectory(simulate(Scene.model_validate(document), 3.0)), tmp_path / "back.png")
    assert distance(tmp_path / "back.png", GOLDEN / "run_ten.png") > 1.5 * TOLERANCE


@pytest.mark.filterwarnings("error")
def test_a_long_name_ends_in_an_ellipsis_and_takes_no_room_from_panels(tmp_path, monkeypatch):
    kept: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: kept.append(figure))
    run = read_trajectory(simulate(PAGES["ten"](), 1.0))
    draw_run(replace(run, title="m" * 200), tmp_path / "long.png")
    written = [text.get_text() for text in kept[0].findobj(Text)]
    assert "m" * 57 + "..." in written
    assert not any("m" * 58 in text for text in written)


def test_a_run_without_states_is_refused():
    run = replace(read_trajectory(simulate(PAGES["three"](), 1.0)), time=np.zeros(0))
    with pytest.raises(CrawlerError, match=r"no\.png: there is no state to draw"):
        draw_run(run, Path("no.png"))


def test_two_columns_are_lower_and_have_more_pixels_for_print(pages, tmp_path):
    draw_run(read_trajectory(simulate(PAGES["ten"](), 3.0)), tmp_path / "two.png", two_columns=True)
    assert distance(tmp_path / "two.png", GOLDEN / "run_two_columns.png") < TOLERANCE
    one, two = Image.open(pages("ten")), Image.open(tmp_path / "two.png")
    assert two.width > 1.4 * one.width
    assert two.height / two.width < 0.85 * one.height / one.width


def test_two_columns_need_a_page(tmp_path, capsys):
    for arguments, status in ((["--png", str(tmp_path / "x.png")], 0), ([], 1)):
        with pytest.raises(SystemExit) as end:
            main(["simulate", "two_anchor_a", "--two-columns", *arguments])
        assert end.value.code == status
    assert "--two-columns needs --png" in capsys.readouterr().err
    assert Image.open(tmp_path / "x.png").width == 1800


def test_vectors_are_commanded_by_component_and_each_curve_has_the_name_of_its_link(monkeypatch):
    commands = read_trajectory(simulate(star(), 1.0)).commands
    assert [(c.what, c.names) for c in commands if c.changes] == [
        (f"change of rest length along {axis}", tuple(f"link_{i}" for i in range(5))) for axis in "xy"
    ]
    lines = words_on_page(star(), monkeypatch).splitlines()
    assert lines.count("link 4") == 2
    assert "tension of 5 links; without bounds, which are not computed in the plane" in lines


def test_rows_of_joints_are_no_contacts(monkeypatch):
    lines = words_on_page(load_scene("ten_link_snake"), monkeypatch).splitlines()
    assert "joint" in lines
    assert "command: change of rest angle, joint 0 (below) to joint 8 (above)" in lines


def test_an_angle_that_is_rounding_is_zero(monkeypatch):
    assert "between 0° and" in words_on_page(load_scene("tripedal_star"), monkeypatch)


def test_no_name_of_a_contact_lies_on_a_link():
    run = read_trajectory(simulate(star(), 3.0))
    figure, axis = plt.subplots(figsize=(7.0, 5.0))
    draw_plane(axis, run.positions, run.state, run.mean, run.ends, list(run.contacts))
    figure.canvas.draw()
    part = np.linspace(0.0, 1.0, 200)[:, None]
    links = [run.positions[-1, a] + part * (run.positions[-1, b] - run.positions[-1, a]) for a, b in run.ends]
    points = axis.transData.transform(np.concatenate(links))
    names = [text for text in axis.texts if text.get_text()]
    assert [text.get_text() for text in names] == list("012345")
    for text in names:
        box = text.get_window_extent()
        assert not ((points > box.min).all(axis=1) & (points < box.max).all(axis=1)).any(), text
    plt.close(figure)


def test_colours_of_forces_are_explained():
    run = read_trajectory(simulate(star(), 1.0))
    figure, axis = plt.subplots()
    draw_friction(axis, run.scene, run.force)
    legend = axis.get_legend()
    shown = {text.get_text(): line for text, line in zip(legend.get_texts(), legend.get_lines(), strict=True)}
    assert [to_hex(shown[str(i)].get_color()) for i in range(6)] == list(LINES[:6])
    plt.close(figure)


def test_jumps_are_explained_and_the_reason_for_missing_bounds_is_that_of_the_scene(monkeypatch):
    lines = words_on_page(on_ice(), monkeypatch).splitlines()
    assert "jumps over a border" in lines
    assert "tension of 4 links; without bounds, which are not computed where the ground differs" in lines
    assert "jumps over a border" not in words_on_page(waving(5, 1.0, 0.1), monkeypatch)


def test_a_slope_has_no_load_of_zero(monkeypatch):
    text = words_on_page(load_scene("slope_climber"), monkeypatch)
    assert "slope 10°" in text
    assert "load" not in text


def test_colours_of_lines_can_be_told_apart():
    """The distance weighs red, green and blue by how much they are seen; orange and a brown of 120 looked alike."""
    colors = [np.array(tuple(bytes.fromhex(color[1:])), float) for color in LINES]
    for a, b in itertools.combinations(colors, 2):
        red = (a[0] + b[0]) / 512.0
        assert np.sqrt(np.array([2.0 + red, 4.0, 3.0 - red]) @ (a - b) ** 2) > 150.0


@pytest.mark.parametrize(
    ("name", "text"), [("tendon_worm", "slack"), ("stalling_inchworm", "stalled"), ("two_anchor_a", "")]
)
def test_the_times_of_slack_and_stalled_links_are_marked(name, text, monkeypatch):
    lines = words_on_page(load_scene(name), monkeypatch).splitlines()
    assert [line for line in lines if line in ("slack", "stalled", "hysteresis yields")] == [text] * bool(text)
