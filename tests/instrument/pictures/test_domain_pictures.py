"""The pages with stasis domains: what is on them, by the colours that only it has."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("matplotlib")
from matplotlib.figure import Figure
from PIL import Image

from crawler_model import Scene, load_scene
from crawler_model.body.turning import load_of_friction
from crawler_model.theory.stasis import domain_evolution
from crawler_pictures.domain import draw_domain
from crawler_pictures.domain_many import draw_box_in_space
from crawler_pictures.domain_panels import forces_in_frames
from crawler_pictures.domain_text import last_period, simulated
from crawler_pictures.domain_two import draw_two

from ...golden_pictures import GOLDEN, differences, read_figure, words_of_figures

FORWARD, BACK, SECTION, DOMAIN = (0, 158, 115), (200, 64, 15), (224, 96, 90), (242, 220, 218)

DOMAIN_OF_A_POINT = (247, 234, 233)


def drawn(scene: Scene, folder: Path) -> np.ndarray:
    draw_domain(scene, folder / "d.png")
    assert (folder / "d.png").stat().st_size > 5_000
    return np.asarray(Image.open(folder / "d.png").convert("RGB")).astype(int)


def count(picture: np.ndarray, color: tuple[int, int, int]) -> int:
    return int((np.abs(picture - color).max(axis=2) <= 4).sum())


def chain(contacts: int, forward: Any, backward: Any, drive: dict[str, Any] | None = None) -> Scene:
    return Scene.model_validate(
        {
            "name": "test",
            "body": {"contacts": list(range(contacts)), "links": {"stiffness": 1.0}},
            "friction": {"forward": forward, "backward": backward},
            **({} if drive is None else {"drive": drive}),
        }
    )


def strokes(links: int, **more: Any) -> dict[str, Any]:
    rows = [[0.0] * links, [4.0] * links, [0.0] * links]
    return {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": rows, **more}


@pytest.mark.parametrize(
    ("name", "ways", "boxes"),
    [
        ("two_contacts_anisotropic", (FORWARD,), 1),
        ("two_anchor_a", (FORWARD, BACK), 4),
        ("two_anchor_b", (FORWARD, BACK), 4),
        ("two_anchor_c", (FORWARD, BACK), 4),
        ("three_contacts_one_way", (FORWARD,), 0),
        ("three_contacts_two_ways", (FORWARD, BACK), 0),
        ("ten_contact_wave", (FORWARD, BACK), 0),
    ],
)
def test_a_page_shows_the_domain_and_which_ways_it_lets_the_body_go(name, ways, boxes, tmp_path):
    picture = drawn(load_scene(name), tmp_path)
    for color in (FORWARD, BACK):
        assert (count(picture, color) > 500) == (color in ways)
    assert count(picture, DOMAIN) > 10_000
    assert (count(picture, SECTION) > 60 * boxes) == (boxes > 0)


def test_constant_friction_shows_the_box_many_times_as_it_is_swept_along(tmp_path):
    """Nine sections besides the first: each mark of the run has its own."""
    picture = drawn(load_scene("two_contacts_anisotropic"), tmp_path)
    red = np.abs(picture - SECTION).max(axis=2) <= 4
    columns = np.flatnonzero(red.sum(axis=0) > 20)
    assert np.count_nonzero(np.diff(columns) > 20) + 1 == 7  # a, b and d, e and g, h stand above one another


@pytest.mark.parametrize(("name", "ends"), [("two_contacts_anisotropic", ", and some between"), ("two_anchor_b", "")])
def test_the_instants_that_are_marked_are_called_ticks(name, ends):
    scene = load_scene(name)
    words = [axis.get_xlabel() for axis in draw_two(scene, simulated(scene, 2)).axes]
    assert f"simulated time [s]; dotted: ticks beside which sliding begins or ends{ends}" in words


def test_where_only_the_backward_friction_is_small_only_backward_is_shown(tmp_path):
    picture = drawn(chain(3, 1.0, 0.3, strokes(2)), tmp_path)
    assert count(picture, FORWARD) < 20
    assert count(picture, BACK) > 500


@pytest.mark.parametrize("contacts", [2, 3, 4])
def test_a_scene_without_a_drive_is_drawn_at_its_start(contacts, tmp_path):
    picture = drawn(chain(contacts, 0.2, 0.5), tmp_path)
    assert count(picture, FORWARD) > 200


@pytest.mark.parametrize("contacts", [2, 3, 4, 60])
@pytest.mark.parametrize(("forward", "backward"), [(0.0, 0.0), (0.0, 1.0), (0.3, 1.0)])
def test_domains_without_an_interior_are_drawn_too(contacts, forward, backward, tmp_path):
    drawn(chain(contacts, forward, backward, strokes(contacts - 1)), tmp_path)


@pytest.mark.parametrize("contacts", [2, 3, 5])
def test_commanded_friction_is_drawn_at_its_waypoints(contacts, tmp_path):
    one_way, other_way = [0.2] * contacts, [2.0] * contacts
    friction = {"forward": [one_way, other_way, one_way], "backward": [other_way, one_way, other_way]}
    picture = drawn(chain(contacts, 0.2, 2.0, strokes(contacts - 1, friction=friction)), tmp_path)
    if contacts < 4:  # beyond, sides are coloured at the first waypoint only
        assert min(count(picture, FORWARD), count(picture, BACK)) > 200


def test_a_drive_of_many_waypoints_or_without_a_period_is_drawn(tmp_path):
    waves = {"amplitude": 0.2, "wavelength": 3.0, "period": 2.0}
    drawn(chain(2, 1.0, 1.0, {"wave": waves, "friction_wave": {**waves, "mean": 1.0}}), tmp_path)
    drawn(chain(3, 1.0, 1.0, {"times": [0.0, 1.0], "actuation": [[0.0, 0.0], [3.0, 1.0]]}), tmp_path)


def test_a_graph_of_springs_is_drawn_by_its_section_forces(tmp_path):
    body = {"contacts": [0, 1, 2], "links": {"stiffness": 1.0, "between": [[0, 1], [1, 2], [0, 2]]}}
    graph = {"name": "graph", "body": body, "friction": {"forward": 0.2, "backward": 0.5}, "drive": strokes(3)}
    assert count(drawn(Scene.model_validate(graph), tmp_path), FORWARD) > 500


def test_a_body_in_the_plane_shows_its_friction_sets(tmp_path):
    body = {"contacts": [[0, 0], [1, 0], [0, 1]], "links": {"stiffness": 1.0, "between": [[0, 1], [1, 2], [0, 2]]}}
    plane = {"name": "plane", "dimension": 2, "body": body, "friction": {"isotropic": 0.2}}
    bears = (242, 218, 218)  # the friction sets, paler than their colour
    picture = drawn(Scene.model_validate(plane), tmp_path).astype(int)
    assert (np.abs(picture - bears).max(axis=2) < 20).sum() > 50_000


def test_a_body_that_turns_shows_what_friction_holds_in_the_frame_of_each_point(tmp_path):
    """On other ground along its blades it slides at other forces, and where it holds still nothing is green."""
    scene = load_scene("scissors")
    moving = drawn(scene, tmp_path)
    assert count(moving, FORWARD) > 100
    still = scene.document()
    still["drive"]["actuation"] = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.01], [0.0, 0.0, 0.0]]
    picture = drawn(Scene.model_validate(still), tmp_path)
    assert count(picture, FORWARD) == 0
    wide = scene.document()
    wide["friction"]["left"] = [2, 2, 2]
    assert count(drawn(Scene.model_validate(wide), tmp_path), DOMAIN_OF_A_POINT) > 1.2 * count(
        picture, DOMAIN_OF_A_POINT
    )


def test_the_forces_of_a_body_that_turns_are_within_what_friction_holds():
    run = simulated(load_scene("three_link_snake"), 3)
    rows = last_period(run)
    columns = run.scene.columns
    friction = run.scene.drive.targets[0, columns.lengths :].reshape(-1, 4)
    load = load_of_friction(forces_in_frames(run, rows), np.zeros(friction.shape[0]), friction)
    slides = run.contact_state[rows] != 0
    held = friction.any(axis=1)
    assert load[:, held].max() <= 1.0 + 1e-6
    assert np.median(load[:, held][slides[:, held]]) == pytest.approx(1.0, abs=1e-6)
    assert load[:, held][~slides[:, held]].min() < 0.99


@pytest.mark.parametrize("contacts", [2, 3, 5])
@pytest.mark.parametrize("driven", [False, True])
def test_loads_move_the_domain_and_can_turn_the_way_that_it_allows(contacts, driven, tmp_path):
    """The last contact is pulled back harder than its own friction: the domain does not contain T = 0."""
    drive = strokes(contacts - 1)
    loads = [0.0] * (contacts - 1) + [-0.7]
    if driven:
        drive["loads"] = [loads, [0.0] * contacts, loads]
    level = chain(contacts, 0.2, [1.5] + [0.5] * (contacts - 1), strokes(contacts - 1))
    loaded = Scene.model_validate(level.document() | {"loads": loads, "start": "relaxed", "drive": drive})
    picture = drawn(loaded, tmp_path)
    assert count(picture, BACK) > 500
    assert count(picture, FORWARD) > 200
    assert count(drawn(level, tmp_path), BACK) < count(picture, BACK)


def loaded_chain() -> Scene:
    """Contacts of different friction, the last of which is pulled back harder than its own friction."""
    level = chain(3, [0.2, 0.3, 0.25], [1.5, 0.5, 0.4], strokes(2))
    return Scene.model_validate(level.document() | {"loads": [0.0, 0.1, -0.7], "start": "relaxed"})


def commanded_chain() -> Scene:
    """Five contacts whose friction is commanded."""
    one, other = [0.2, 0.25, 0.3, 0.35, 0.4], [2.0, 1.9, 1.8, 1.7, 1.6]
    friction = {"forward": [one, other, one], "backward": [other, one, other]}
    return chain(5, 0.2, 2.0, strokes(4, friction=friction))


PAGES = {
    "two_at_rest": lambda: chain(2, [0.2, 0.3], [0.5, 0.6]),
    "three_at_rest": lambda: chain(3, [0.2, 0.3, 0.4], [0.5, 0.6, 0.8]),
    "four_at_rest": lambda: chain(4, [0.2, 0.3, 0.4, 0.1], [0.5, 0.6, 0.8, 0.7]),
    "loaded": loaded_chain,
    "commanded": commanded_chain,
}


@pytest.mark.parametrize(
    "name",
    [
        "two_contacts_anisotropic",
        "two_anchor_a",
        "two_anchor_b",
        "three_contacts_two_ways",
        "ten_contact_wave",
        "hybrid_body",
        "planar_three_points",
        "scissors",
        *PAGES,
    ],
)
def test_the_words_and_curves_of_a_page_are_those_that_were_read(name, tmp_path):
    with words_of_figures() as words:
        draw_domain(PAGES[name]() if name in PAGES else load_scene(name), tmp_path / "d.png")
    assert not differences(words[0], GOLDEN / f"domain_{name}.txt")


def test_the_box_of_three_spring_forces_is_the_one_that_was_read():
    domain = domain_evolution(PAGES["three_at_rest"]().drive)[1][0]
    figure = Figure()
    draw_box_in_space(figure.add_subplot(projection="3d"), domain)
    assert not differences(read_figure(figure), GOLDEN / "box_in_space.txt")
