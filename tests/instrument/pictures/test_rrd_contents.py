"""What a file for rerun holds, compared with summaries of views that were looked at: places, colours and words."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("rerun")
from crawler_model import Crawler, Scene, load_scene
from crawler_ros.viewer.frames import frame_of
from crawler_ros.viewer.visualizer import Drawing, to_file

from ...golden_pictures import GOLDEN, differences, read_rrd
from ...scenes import wave_scene
from .test_ground_pictures import hilly
from .test_pictures import entities
from .test_run_pages import star


def far_on_hills() -> Scene:
    """A body that has walked on to another page of its track, onto patches with slopes."""
    document = hilly(3.0).document()
    document["start"] = {"displacement": [7.0, 7.0]}
    return Scene.model_validate(document)


SCENES: dict[str, Callable[[], Scene]] = {
    "far_on_hills": far_on_hills,
    "star": star,
    "wave": lambda: wave_scene(60, 20.0),
    **{
        name: lambda name=name: load_scene(name)
        for name in (
            "two_anchor_b",
            "three_contacts_two_ways",
            "hybrid_body",
            "planar_rectilinear",
            "tripedal_star",
            "tendon_worm",
        )
    },
}


@pytest.mark.parametrize("name", SCENES)
def test_a_view_holds_what_was_read(name, tmp_path):
    scene = SCENES[name]()
    drawing, crawler = Drawing(scene, to_file(tmp_path / "x.rrd")), Crawler(scene)
    for ns in range(0, 1_000_000_001, 20_000_000):
        crawler.follow(scene.drive.sample(np.array([ns])))
        drawing.draw(frame_of(crawler, ns, crawler.contact_state))
    drawing.close()
    assert not differences(read_rrd(tmp_path / "x.rrd"), GOLDEN / f"rrd_{name}.txt")


def test_a_view_goes_on_where_a_wall_holds_what_friction_does_not(tmp_path):
    """The stasis domain is empty then, and is drawn again as the load is gone."""
    drive = {"times": [0, 0.5, 1], "actuation": [[0, 0]] * 3, "loads": [[0, 0, 0], [0, 3, 0], [0, 0, 0]]}
    scene = Scene.model_validate(
        {
            "name": "held",
            "body": {"contacts": [0.0, 0.2, 0.4], "links": {"stiffness": 20.0}},
            "friction": {"forward": 0.2, "backward": 0.5},
            "ground": {"walls": [{"at": 0.4, "stops": "forward"}]},
            "drive": drive,
            "loads": 0.0,
        }
    )
    drawing, crawler = Drawing(scene, to_file(tmp_path / "x.rrd")), Crawler(scene)
    for ns in range(0, 1_000_000_001, 250_000_000):
        crawler.follow(scene.drive.sample(np.array([ns])))
        drawing.draw(frame_of(crawler, ns, crawler.contact_state))
    drawing.close()
    drawn = entities(tmp_path / "x.rrd")
    assert drawn["/stasis/point"] == 5
    assert drawn["/stasis/domain"] == 5
