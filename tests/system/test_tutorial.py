"""docs/tutorial.md: its figures have the numbers of the closed forms, and equal the committed ones."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")
import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from PIL import Image

from crawler_lab import simulate_many, vary
from crawler_model import Crawler, Scene, load_scene, simulate
from crawler_model.theory.stasis import StasisDomain, spring_force
from crawler_pictures.body import draw_body
from crawler_pictures.colors import FORWARD
from crawler_pictures.domain_text import STYLE

DOCS = Path(__file__).parent.parent.parent / "docs"
PICTURES = DOCS / "pictures" / "tutorial"
TEXT = (DOCS / "tutorial.md").read_text(encoding="utf-8")
NAMES = re.findall(r"\]\(pictures/tutorial/(\w+\.png)\)", TEXT)
SAME, ALIKE = 0.02, 0.5
"""Largest difference of a figure from the committed one: drawn by the same matplotlib, by another (other letters)."""


class Page:
    """The page, run once: its names, its figures by file name, and the folder that they are in."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.figures: dict[str, Figure] = {}
        spec = importlib.util.spec_from_file_location("tutorial", DOCS / "tutorial.py")
        tutorial = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(tutorial)
        save = Figure.savefig

        def keep(figure: Figure, name: str, **options) -> None:
            self.figures[name] = figure
            save(figure, name, **options)

        with pytest.MonkeyPatch.context() as patched, matplotlib.rc_context():
            patched.setattr(Figure, "savefig", keep)
            self.names = tutorial.run(folder)

    def lines(self, figure: str, axis: int) -> dict[str, np.ndarray]:
        """The named lines of an axis, each of shape (K, 2)."""
        axes = self.figures[figure].axes[axis]
        return {line.get_label(): line.get_xydata() for line in axes.lines if not line.get_label().startswith("_")}

    def polygon(self, figure: str, axis: int) -> set[tuple[float, float]]:
        """The corners of the first filled polygon of an axis."""
        return corners(self.figures[figure].axes[axis].patches[0].get_xy())


def corners(points) -> set[tuple[float, float]]:
    return {(round(float(x), 3) + 0.0, round(float(y), 3) + 0.0) for x, y in points}


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    yield Page(tmp_path_factory.mktemp("tutorial"))
    plt.close("all")


def difference(one: Path, other: Path, block: int) -> float:
    """The ink that differs between two pictures, blurred over blocks, as part of the ink of either."""
    ink = []
    for path in (one, other):
        picture = 255.0 - np.asarray(Image.open(path).convert("RGB"), dtype=float)
        high, wide = (side // block * block for side in picture.shape[:2])
        blocks = picture[:high, :wide].reshape(high // block, block, wide // block, block, 3)
        ink.append(blocks.mean(axis=(1, 3)))
    return float(np.abs(ink[0] - ink[1]).sum() / max(ink[0].sum(), ink[1].sum()))


def drawn_by(picture: Path) -> list[str]:
    return re.findall(r"\d+", Image.open(picture).info["Software"])[:2]


def at(line: np.ndarray, time: float) -> float:
    """A line's height, straight between its points."""
    return float(np.interp(time, *line.T))


# The page and its pictures


def test_the_page_shows_every_figure_that_it_draws_and_no_other(page):
    assert len(NAMES) == 11
    assert (
        set(NAMES)
        == set(page.figures)
        == {p.name for p in PICTURES.iterdir()}
        == {p.name for p in page.folder.iterdir()}
    )


def test_it_names_every_figure_of_the_paper():
    rows = re.findall(r"^\| ([\d, ]+) \|.*\| (yes|no)\b.*\| \[\d+\]\(#", TEXT, re.M)
    assert sorted(int(n) for numbers, _ in rows for n in numbers.split(",")) == list(range(1, 9))


@pytest.mark.parametrize("name", NAMES)
def test_the_committed_figures_are_what_the_code_draws(page, name):
    """`make docs` draws them anew. Letters have other sizes in another matplotlib, and move what is next to them."""
    assert (PICTURES / name).stat().st_size < 150_000
    one, other = PICTURES / name, page.folder / name
    assert Image.open(one).size == Image.open(other).size
    if drawn_by(one) == drawn_by(other):
        assert difference(one, other, block=4) < SAME
    assert difference(one, other, block=20) < ALIKE


def test_a_figure_with_another_number_would_be_noticed(page, tmp_path):
    figure = page.figures["strategy_a.png"]
    line = next(line for line in figure.axes[0].lines if line.get_label() == "tension")
    kept = line.get_ydata()
    with matplotlib.rc_context(STYLE):
        for name, tension in (("first", kept), ("changed", 0.95 * kept), ("again", kept)):
            line.set_ydata(tension)
            figure.savefig(tmp_path / f"{name}.png", dpi=100)
    assert difference(tmp_path / "first.png", tmp_path / "again.png", block=4) < SAME
    assert difference(tmp_path / "first.png", tmp_path / "changed.png", block=4) > SAME


def test_another_figure_would_be_noticed_whatever_the_letters(page, tmp_path):
    picture = Image.open(page.folder / "strategies.png")
    picture.resize(Image.open(page.folder / "not_unique.png").size).save(tmp_path / "other.png")
    assert difference(page.folder / "not_unique.png", tmp_path / "other.png", block=20) > ALIKE


# Its numbers


def test_the_body_stands_where_the_run_has_it_and_has_walked_70_mm(page):
    legs = []
    for axis in page.figures["body.png"].axes:
        found = [line.get_xdata()[0] for line in axis.lines if np.array_equal(line.get_ydata(), [0.0, 1.0])]
        legs.append(found[:3])  # the dotted lines reach over the axis from 0 to 1, too
    run, place = page.names["run"], page.names["run"].scene.body.position
    np.testing.assert_allclose(legs, place + run.displacement[[200, 225, 275, 300]], atol=1e-15)
    np.testing.assert_allclose(np.subtract(legs[3], legs[0]), 0.1 - 2 * 0.3 / 20, atol=1e-15)
    titles = [axis.get_title(loc="left") for axis in page.figures["body.png"].axes]
    assert [re.findall(r"= (-?[\d.]+) N", title) for title in titles] == [
        ["0.3", "0.0"],
        ["0.0", "-0.3"],
        ["-0.3", "0.0"],
        ["0.3", "0.0"],
    ]


def test_both_readings_of_a_link_have_its_tension(page):
    """A spring of rest length 0.15 + L; an actuator of 0.075 + L and a spring of rest length 0.075."""
    run = page.names["run"]
    shape = np.diff(run.displacement[225])
    length = np.array([0.0, 0.1])
    spring = 20.0 * ((0.15 + shape) - (0.15 + length))
    behind_actuator = 20.0 * ((0.15 + shape) - (0.075 + length) - 0.075)
    np.testing.assert_allclose(run.tension[225], spring, atol=1e-12)
    np.testing.assert_allclose(run.tension[225], behind_actuator, atol=1e-12)


def test_the_boxes_of_two_contacts_are_the_papers(page):
    assert page.polygon("two_contacts.png", 0) == {(0.5, 1.5), (-1.0, 0.0), (0.5, -1.5), (2.0, 0.0)}
    assert page.polygon("two_contacts.png", 1) == {(0.0, 1.5), (-1.5, 0.0), (0.0, -1.5), (1.5, 0.0)}
    pairs = list(page.names["pairs"].values())
    assert [sorted(pair.vertices()[:, 0]) for pair in pairs] == [[-1.0, 1.0], [-1.5, 1.5]]
    assert {facet.direction for facet in pairs[0].facets()} == {-1}
    assert pairs[1].facets() == ()


def test_the_triangle_wave_slides_back_by_14_m_and_then_by_12(page):
    lettered = list(page.names["letters"].values())
    x = np.array([[0, 0, -7, -14, -14, -14, -14, -14, -21], [0, 0, 0, 0, 0, -6, -12, -12, -12]])
    lines = page.lines("triangle_wave.png", 1)
    for contact in (0, 1):
        drawn = [at(lines[f"$x_{contact}$"], time) for time in lettered]
        np.testing.assert_allclose(drawn, x[contact], atol=1e-12)
    y = lines["net translation $y$"]
    assert at(y, 48) - at(y, 16) == pytest.approx(-(16 - 2 * 2), abs=1e-12)
    points = [line for line in page.figures["triangle_wave.png"].axes[0].lines if line.get_marker() == "o"]
    state = np.array([point.get_xydata()[0] for point in points])
    np.testing.assert_allclose(state, np.column_stack((x.sum(axis=0), x[1] - x[0])), atol=1e-12)  # 2 k y, k z


def test_the_solutions_that_are_not_unique_are_the_papers_interval(page):
    lines = page.lines("not_unique.png", 0)
    for label, rate in (
        ("contact 1 slides forward", 0.5),
        ("contact 0 slides back", -0.5),
        ("taken here: nearest to zero", 0),
    ):
        lengths, y = lines[label].T
        np.testing.assert_allclose(y, rate * (lengths - 1.0), atol=1e-12)
    assert not any(step.unique for step in page.names["steps"][1:])


def test_the_polygons_of_three_contacts_are_the_papers_turned_round(page):
    triangle = {(-1, 1), (2, 1), (-1, -2)}
    hexagon = {(-1, -4 / 3), (-1 / 3, -4 / 3), (4 / 3, 1 / 3), (4 / 3, 1), (-1 / 3, 1), (-1, 1 / 3)}
    for axis, papers in ((1, triangle), (3, hexagon)):
        assert page.polygon("three_contacts.png", axis) == corners(-np.array(sorted(papers)))


def test_the_sides_of_the_section_lie_in_the_faces_of_the_box(page):
    for axis, domain in zip(page.figures["three_contacts.png"].axes[::2], page.names["threes"].values(), strict=True):
        sides = [(line.get_color(), np.transpose(line.get_data_3d())) for line in axis.lines]
        assert len(sides) == len(domain.vertices())
        for color, ends in sides:
            np.testing.assert_allclose(ends.sum(axis=1), 0.0, atol=1e-12)
            assert (np.abs(ends - spring_force(domain.vertices())[:, None]).max(axis=2) < 1e-12).any(axis=0).all()
            bound = domain.forward if color == FORWARD else -domain.backward
            assert (np.abs(ends - bound).max(axis=0) < 1e-12).any()


def test_the_segment_gains_what_the_closed_form_says(page):
    lines = page.lines("segment.png", 1)
    np.testing.assert_allclose(lines["simulated"][:, 1], lines["closed form"][:, 1], atol=1e-12)
    strain, gain = lines["closed form"].T
    np.testing.assert_allclose(gain, np.where(strain > 0.1, (strain - 0.1) / 2.0, 0.0), atol=1e-15)
    picture = page.figures["segment.png"].axes[0].images[0].get_array()
    assert picture.shape == (101, 100)
    for column, stands in ((45, 25), (95, 75)):
        assert np.flatnonzero(picture[:, column] == 0).tolist() == [stands]


def test_the_body_in_the_plane_gains_the_stroke_less_what_loading_takes(page):
    stroke = np.array([0.06, 0.03])
    gain = stroke * (1.0 - 0.3 / 20.0 / np.hypot(*stroke))
    outlines = page.lines("plane.png", 0)
    np.testing.assert_allclose(outlines["t = 3 s"] - outlines["t = 2 s"], np.tile(gain, (4, 1)), atol=1e-12)


PAPERS_FRICTION = {
    "A": (
        lambda t: np.select([t <= 0.25, t <= 0.75], [1 + 2 * t, 2 - 2 * t], 2 * t - 1),
        lambda t: np.select([t <= 0.25, t <= 0.75], [1 - 2 * t, 2 * t], 3 - 2 * t),
    ),
    "B": (
        lambda t: np.where(t <= 0.5, 0.5 + 2 * t, 2.5 - 2 * t),
        lambda t: np.where(t <= 0.5, 1.5 - 2 * t, 2 * t - 0.5),
    ),
    "C": (
        lambda t: np.select([t <= 0.25, t <= 0.5, t <= 0.75], [0.5 + 4 * t, 1.5 + 0 * t, 3.5 - 4 * t], 0.5),
        lambda t: np.select([t <= 0.25, t <= 0.5, t <= 0.75], [0.5 + 0 * t, 4 * t - 0.5, 1.5 + 0 * t], 4.5 - 4 * t),
    ),
}


def test_the_strategies_are_the_papers(page):
    time = np.linspace(0.0, 1.0, 101)
    actuation = page.figures["strategies.png"].axes[0].lines[0].get_xydata()
    np.testing.assert_allclose(np.interp(time, *actuation.T), 4.0 * np.minimum(2 * time, 2 - 2 * time), atol=1e-12)
    for axis, formulas in zip((1, 2, 3), PAPERS_FRICTION.values(), strict=True):
        lines = page.lines("strategies.png", axis)
        for contact, formula in enumerate(formulas):
            np.testing.assert_allclose(np.interp(time, *lines[f"contact {contact}"].T), formula(time), atol=1e-12)


PAPERS_BOXES = {
    "A": [(0, 1), (-0.4, 1), (-0.2, 1), (0, 1), (0.2, 1), (0.4, 1)],
    "B": [(0.5, 1), (0.1, 1), (-0.3, 1), (-0.5, 1), (-0.3, 1), (0.1, 1)],
    "C": [(0, 0.5), (-0.4, 0.9), (-0.2, 1.3), (0, 1.5), (0.2, 1.3), (0.4, 0.9)],
}
"""The top corner of each box, in -T; (x, y) gives the others by turning and mirroring: (-y, -x), (-x, -y), (y, x)."""


def test_the_boxes_of_the_strategies_are_the_papers_upside_down(page):
    papers = [top for row in PAPERS_BOXES.values() for top in row]
    assert len(papers) == 18
    for axis, (x, y) in enumerate(papers):
        box = np.array([(x, y), (-y, -x), (-x, -y), (y, x)])
        assert page.polygon("strategy_domains.png", axis) == corners(box * (1, -1))


def test_strategy_a_has_the_papers_times_and_speeds(page):
    tension = page.lines("strategy_a.png", 0)["tension"]
    y = page.figures["strategy_a.png"].axes[1].lines[0].get_xydata()
    times = (0.0, 0.2, 0.25, 0.5, 0.7, 0.75, 1.0)
    assert [at(tension, t) for t in times] == pytest.approx([1, -0.6, -0.5, -1, 0.6, 0.5, 1], abs=1e-9)
    assert [at(y, t) for t in times] == pytest.approx([0, 0, 0.25, 1, 1, 1.25, 2], abs=1e-9)
    assert sorted(page.names["kinks"].values()) == list(times[1:-1])


def test_each_strategy_goes_as_far_as_its_closed_form(page):
    lines = page.lines("how_far.png", 0)
    closed = {
        "A": lambda a: np.maximum(a - 2.0, 0.0),
        "B": lambda a: np.clip(a - 1.0, 0.0, 2.0),
        "C": lambda a: np.maximum(a - 2.0, 0.0),
        "A, half a period late": lambda a: -np.maximum(a - 2.0, 0.0),
    }
    assert set(lines) == set(closed)
    for name, formula in closed.items():
        amplitude, gain = lines[name].T
        np.testing.assert_allclose(gain, formula(amplitude), atol=1e-12)
    ways = page.lines("how_far.png", 1)
    for label, line in ways.items():
        a = float(re.search(r"= (\d)", label)[1])
        start = 0.5 / (a - 1.0)  # t_3 of [G]; beyond a quarter nothing slides back
        back = (a - 1.0) * max(0.25 - start, 0.0)
        assert line[:, 1].min() == pytest.approx(-back, abs=1e-9)
        assert line[-1, 1] == pytest.approx(min(a - 1.0, 2.0), abs=1e-9)


# What it proposes to try


def test_the_gait_reversed_walks_back():
    document = load_scene("three_contacts_two_ways").document()
    drive = document["drive"]
    drive["actuation"] = drive["actuation"][::-1]
    drive["times"] = [1.0 - t for t in reversed(drive["times"])]
    assert simulate(Scene.model_validate(document)).per_period[-1] == pytest.approx(-0.07, abs=1e-12)


def test_of_a_heavy_and_a_light_contact_the_light_one_slides_both_ways():
    facets = StasisDomain([3.0, 1.0], [3.0, 1.0]).facets()
    assert [(facet.contact, facet.direction) for facet in facets] == [(1, 1), (1, -1)]


def test_a_faster_wave_gives_the_same_path(page):
    document = dict(page.names["two_contacts"])
    document["drive"] = {"times": [0, 0.5, 1.0], "period": 1.0, "actuation": [[0.0], [16.0], [0.0]]}
    fast = simulate(Scene.model_validate(document), duration=2.0, rate=32.0)
    np.testing.assert_allclose(fast.displacement, page.names["two"].displacement, atol=1e-9)


def test_the_fan_closes_to_its_upper_edge(page):
    friction = {"forward": 1.0, "backward": 1.001}
    crawler = Crawler(Scene.model_validate(page.names["two_contacts"] | {"friction": friction}))
    crawler.advance([1.0])
    step = crawler.advance([5.0])
    assert step.unique
    assert step.translation_interval == pytest.approx((2.0, 2.0), abs=1e-12)


def test_below_its_threshold_strategy_a_steps_back_once():
    run = simulate(vary(load_scene("two_anchor_a"), {"drive.length": [0.5]})[0], duration=5.0)
    y = run.net_translation - run.net_translation[0]
    assert y[26:] == pytest.approx(-1 / 8, abs=1e-12)
    assert not run.contact_state[26:].any()


def test_the_gain_depends_on_one_number_alone():
    runs = simulate_many(
        vary(load_scene("two_anchor_b"), {"drive.length": [2.0, 4.0, 5.0, 10.0], "drive.friction": [1.0, 2.0]})
    )
    gain = runs.per_period.reshape(4, 2)
    assert gain[1, 1] == pytest.approx(2 * gain[0, 0], abs=1e-12)  # 4/2 and 2/1
    assert gain[3, 1] == pytest.approx(2 * gain[2, 0], abs=1e-12)


def test_only_chains_are_drawn_as_bodies():
    axis = Figure().subplots()
    for name in ("three_springs", "continuous_segment", "planar_three_points"):
        scene = load_scene(name)
        with pytest.raises(ValueError, match="only chains of isolated contacts"):
            draw_body(axis, scene, np.zeros(scene.body.position.shape), np.zeros(scene.body.springs))
