"""Kymographs of plain arrays: no slip is lost on the way to the pixels, however short it is or many contacts there are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("matplotlib")
from matplotlib import pyplot as plt

from crawler_model import Scene, load_scene
from crawler_pictures.colors import BACK, BOTH, FORWARD, STICK, rgb
from crawler_pictures.numbers import choose_prefix, error_of, label_values
from crawler_pictures.run.arrays import Gains
from crawler_pictures.run.cycles import draw_gains
from crawler_pictures.run.forces import draw_tensions, join_names
from crawler_pictures.run.kymograph import draw_positions, draw_states
from crawler_pictures.run.pixels import divide, join_extremes, join_states, thin


@pytest.fixture
def axis():
    figure, axis = plt.subplots()
    yield axis
    plt.close(figure)


def image_of(axis) -> np.ndarray:
    (image,) = axis.get_images()
    return np.asarray(image.get_array())


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=40), st.integers(1, 60))
def test_every_interval_has_a_pixel_and_every_pixel_an_interval(steps, count):
    edges = np.append(0.0, np.cumsum(steps))
    first, last = divide(edges, count)
    assert (last > first).all()
    assert first[0] == 0
    assert last[-1] == len(steps)
    assert (first[1:] <= last[:-1]).all()


def test_states_join_and_both_directions_have_a_name():
    state = np.array([[0], [1], [0], [-1], [0], [0]])
    assert join_states(state, np.array([0, 2, 4]), np.array([2, 4, 6])).ravel().tolist() == [1, -1, 0]
    assert join_states(state, np.array([0]), np.array([6])).ravel().tolist() == [2]
    assert join_states(np.array([[2], [0]]), np.array([0]), np.array([2])).ravel().tolist() == [2]


def test_extremes_keep_their_sign_and_pass_over_what_is_not_known():
    values = np.array([[1.0, np.nan], [-3.0, np.nan], [2.0, 0.5]])
    assert join_extremes(values, np.array([0]), np.array([3])).tolist() == [[-3.0, 0.5]]
    assert np.isnan(join_extremes(values, np.array([0]), np.array([2]))[0, 1])


def test_one_tick_of_slip_among_a_million_stays_in_the_picture(axis):
    time = np.linspace(0.0, 1e4, 100_001)
    state = np.zeros((time.size, 10), np.int8)
    state[70_000, 3] = -1
    note = draw_states(axis, time, state)
    found = np.argwhere((image_of(axis) == rgb(BACK)).all(axis=2))
    assert found.tolist() == [[3, 699]]
    assert note == "a pixel joins 10 s and shows every slip in it"


def test_one_contact_in_ten_thousand_stays_in_the_picture(axis):
    time = np.linspace(0.0, 1.0, 201)
    state = np.zeros((time.size, 10_000), np.int8)
    state[100, 7_777] = 1
    note = draw_states(axis, time, state)
    image = image_of(axis)
    assert image.shape[:2] == (400, 1000)
    rows, columns = np.nonzero((image == rgb(FORWARD)).all(axis=2))
    assert set(rows.tolist()) == {7_777 // 25}
    assert columns.size == 5
    assert (image == rgb(STICK)).all(axis=2).sum() == 400_000 - 5
    assert note == "a pixel joins 25 contacts and shows every slip in it"


def test_slips_in_both_directions_within_a_pixel_are_neither(axis):
    time = np.linspace(0.0, 1.0, 4001)
    state = np.tile(np.array([[1], [-1]]), (2001, 1))[: time.size]
    draw_states(axis, time, state)
    assert (image_of(axis) == rgb(BOTH)).all()


def test_gaps_between_the_parts_of_a_hybrid_stay_empty(axis):
    names = [*(f"trunk/contact_{k}" for k in range(5)), "contact_0"]
    state = np.ones((3, 6), np.int8)
    draw_states(axis, np.array([0.0, 1.0, 2.0]), state, names, np.array([0.0, 0.25, 0.5, 0.75, 1.0, 2.0]))
    column = (image_of(axis)[:, 0] == rgb(FORWARD)).all(axis=1)
    edges = np.flatnonzero(np.diff(column)) / column.size
    assert edges == pytest.approx([0.5, 0.985], abs=0.01)


def test_a_thinned_run_keeps_its_slips_and_its_end():
    time, positions = np.arange(10_001.0), np.arange(10_001.0)[:, None]
    state = np.zeros((time.size, 1), np.int8)
    state[5_432] = 1
    at, place, moving = thin(time, positions, state, 100)
    assert at.size == 101
    assert (at[-1], place[-1, 0]) == (10_000.0, 10_000.0)
    (slip,) = np.flatnonzero(moving[:, 0])
    assert at[slip - 1] < 5_432 <= at[slip]


def test_lines_show_a_slip_of_a_single_sample(axis):
    time = np.linspace(0.0, 1.0, 3000)
    state = np.zeros((3000, 1), np.int8)
    state[1500] = 1
    draw_positions(axis, time, np.zeros((3000, 1)), state, ["contact_0"])
    marks = [line for line in axis.lines if line.get_marker() == "s"]
    assert [line.get_xdata().tolist() for line in marks] == [[time[1500]]]


def test_tensions_are_measured_from_the_middle_between_their_bounds(axis):
    tension = np.array([[0.0, 1.0], [1.0, 0.5], [-0.5, 2.0]])
    least, most = np.array([-1.0, 1.0]) * np.ones((3, 1)), np.array([1.0, 3.0]) * np.ones((3, 1))
    draw_tensions(axis, np.arange(3.0), tension, least, np.where(tension == 2.0, 1.0, most), ["link_0", "link_1"])
    image = np.ma.filled(axis.get_images()[0].get_array(), np.nan)
    assert image[0, [0, -1]].tolist() == [1.0, -0.5]
    assert image[1, 0] == -1.0
    assert np.isnan(image[1, -1])  # no room between the bounds
    words = [text.get_text() for text in axis.get_legend().get_texts()]
    assert words == ["lower bound, −1 .. 1 N", "middle", "upper bound, 1 .. 3 N", "no room: its bounds meet"]


def test_a_bound_of_zero_has_no_sign(axis):
    zero, one = np.zeros((3, 2)), np.ones((3, 2))
    draw_tensions(axis, np.arange(3.0), 0.5 * one, -zero, one, ["link_0", "link_1"])
    assert axis.get_legend().get_texts()[0].get_text() == "lower bound, 0 .. 0 N"


@pytest.mark.parametrize(
    ("names", "label", "ticks"),
    [
        (["link_0", "link_1", "link_2"], "link", None),
        (["trunk/element_0", "trunk/element_1", "trunk/element_2"], "element\nof trunk", None),
        (["trunk/element_0", "trunk/element_1", "link_0"], "", {0.5: "trunk", 2.0: "link 0"}),
        (["link_0", "front_leg", "tail"], "", {0.0: "link 0", 1.0: "front leg", 2.0: "tail"}),
    ],
)
def test_rows_of_tensions_are_named_as_the_commands_are(axis, names, label, ticks):
    unknown = np.full((3, 3), np.nan)
    draw_tensions(axis, np.arange(3.0), np.ones((3, 3)), unknown, unknown, names)
    assert axis.get_ylabel() == label
    if ticks is not None:
        assert dict(zip(axis.get_yticks(), (t.get_text() for t in axis.get_yticklabels()), strict=True)) == ticks


@pytest.mark.parametrize(("size", "room"), [(1.0, 0.1), (2.0, 0.2)])
def test_what_is_only_rounding_is_drawn_flat(axis, size, room):
    axis.plot([0.0, 1.0], [0.0, 1e-13])
    label_values(axis, "y", "m", size)
    assert np.ptp(axis.get_ylim()) == pytest.approx(room)


def test_bars_of_rounding_are_not_drawn():
    figure = plt.figure()
    draw_gains(figure, Gains(np.array([1e-13, -3e-14]), np.zeros(2, bool), (1e-13, 0.5), 2), 1.0, False)
    left, right = figure.axes
    assert [bar.get_height() for bar in left.patches] == [0.0, 0.0]
    assert [bar.get_height() for bar in right.patches] == [0.0, -0.5, 0.0]
    assert left.get_ylim()[1] - left.get_ylim()[0] >= 0.1
    plt.close(figure)


@pytest.mark.parametrize(
    ("size", "unit", "wanted"),
    [
        (1.0, "m", (1.0, "m")),
        (0.02, "m", (1e-3, "mm")),
        (3e-5, "N", (1e-6, "µN")),
        (2e4, "J", (1e3, "kJ")),
        (0.001, "1", (1.0, "")),
        (0.0, "m", (1.0, "m")),
    ],
)
def test_units_suit_the_numbers(size, unit, wanted):
    assert choose_prefix(size, unit) == wanted


def test_the_error_of_lengths_grows_with_the_strokes_of_a_body_in_the_plane():
    scene = load_scene("planar_three_points")
    document = scene.document()
    document["drive"]["actuation"] = (2.0 * np.array(document["drive"]["actuation"])).tolist()
    assert error_of(scene) == pytest.approx(6e-6)
    assert error_of(Scene.model_validate(document)) == pytest.approx(2.0 * error_of(scene))
    assert error_of(load_scene("two_anchor_a")) == 0.0


def test_names_of_equal_curves_are_joined():
    assert join_names(["contact_0/forward", "contact_1/forward"]) == "contact 0, 1 forward"
    assert join_names([f"link_{i}" for i in range(9)]) == "link 0, 1 .. 8"
    assert join_names([f"joint_{i}/rest_angle" for i in (0, 1, 3, 4, 7)]) == "joint 0, 1 and 3 more rest_angle"
    assert join_names(["trunk"]) == "trunk"
