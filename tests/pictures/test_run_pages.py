"""The page of a run for bodies of every kind, beside pages that were looked at."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")
from crawler_model import Scene, load_scene, simulate
from crawler_pictures.run.page import draw_run
from crawler_pictures.run.trajectory import read_trajectory

from ..golden_pictures import GOLDEN, TOLERANCE, distance


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


PAGES = {
    "three": lambda: load_scene("three_contacts_two_ways"),
    "six": lambda: waving(6, 1.0, 0.05),
    "ten": lambda: load_scene("ten_contact_wave"),
    "thousand": lambda: waving(1000, 0.5, 0.0003),
    "segment": lambda: load_scene("peristaltic_segment"),
    "hybrid": lambda: load_scene("hybrid_body"),
    "plane": lambda: load_scene("planar_three_points"),
}


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    folder, drawn = tmp_path_factory.mktemp("pages"), {}

    def draw(name: str) -> Path:
        if name not in drawn:
            drawn[name] = folder / f"{name}.png"
            draw_run(read_trajectory(simulate(PAGES[name](), 3.0)), drawn[name])
        return drawn[name]

    return draw


@pytest.mark.parametrize("name", PAGES)
def test_the_page_is_the_one_that_was_looked_at(pages, name):
    assert distance(pages(name), GOLDEN / f"run_{name}.png") < TOLERANCE


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
