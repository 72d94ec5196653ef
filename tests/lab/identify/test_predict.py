"""Predictions with bands: against samples of the posterior, over bounds, and what is refused."""

from __future__ import annotations

import copy
import dataclasses
import json

import numpy as np
import pytest

from crawler_lab import Posterior, identify, predict, read_posterior
from crawler_lab.identify.replica.playback import scale_drive
from crawler_lab.identify.sensor.sensor import Prior, Sensor
from crawler_lab.sweep.vary import Variations
from crawler_model import CrawlerError, Scene, limit_cycle, load_scene, simulate

from .posteriors import BACKWARD, FORWARD, NAMES, PERIODIC, posterior, printed, robot
from .synthetic import chain, measure, scaled, walk

LEFT = "friction.backward[0]"
EXCITING = {"times": [0.0, 1.0, 2.0, 3.0], "actuation": [[0.0, 0.0], [0.1, 0.0], [-0.05, 0.1], [0.0, 0.0]]}


def varied(scene: Scene, values: dict[str, float]) -> Scene:
    return Variations(scene, {key: np.array([value]) for key, value in values.items()}, (1,))[0]


def width(samples: np.ndarray) -> float:
    low, high = np.quantile(samples, (0.025, 0.975))
    return float(high - low)


def test_the_bands_of_a_period_agree_with_samples_of_the_posterior():
    known, scene = posterior(), robot()
    found = predict(scene, known)
    drawn = known.draw(np.random.default_rng(1), 400)
    cycles = [limit_cycle(one) for one in Variations(scene, dict(zip(NAMES, drawn.T, strict=True)), (400,))]
    assert found.gain.high - found.gain.low == pytest.approx(width(np.array([c.gain for c in cycles])), rel=0.15)
    assert found.energy.high - found.energy.low == pytest.approx(width(np.array([c.work for c in cycles])), rel=0.15)
    assert found.gain.value == pytest.approx(limit_cycle(scene).gain, abs=1e-12)
    assert found.energy.value == pytest.approx(limit_cycle(scene).work, abs=1e-12)
    assert found.depends_on_bounds == ()
    assert found.notes == ()


def test_the_bands_of_a_whole_drive_agree_with_samples_of_the_posterior():
    known, scene = posterior(), robot()
    found = predict(scene, known, EXCITING, rate=20.0)
    drawn = known.draw(np.random.default_rng(2), 400)
    driven = robot(EXCITING)
    runs = [simulate(one, None, 20.0) for one in Variations(driven, dict(zip(NAMES, drawn.T, strict=True)), (400,))]
    gains = np.array([run.net_translation[-1] - run.net_translation[0] for run in runs])
    assert found.gain.high - found.gain.low == pytest.approx(width(gains), rel=0.15)
    works = np.array([run.energy.work for run in runs])
    assert found.energy.high - found.energy.low == pytest.approx(width(works), rel=0.15)
    last = np.array([run.position[-1, 2] for run in runs])
    assert found.high[-1, 2] - found.low[-1, 2] == pytest.approx(width(last), rel=0.15)
    assert found.periods is None
    assert found.run_gain == found.gain
    assert found.time[-1] == 3.0
    np.testing.assert_allclose(found.position, simulate(driven, None, 20.0).position, atol=1e-12)


def test_the_first_periods_are_those_that_are_run():
    scene = robot()
    found = predict(scene, posterior(), periods=3)
    run = simulate(scene, 3.0)
    assert found.periods == 3
    assert found.run_gain.value == pytest.approx(run.net_translation[-1], abs=1e-12)
    assert found.run_energy.value == pytest.approx(run.energy.work, abs=1e-12)
    assert found.position.shape == found.low.shape == (found.time.size, 3)
    assert (found.low <= found.position).all()
    assert (found.position <= found.high).all()


@pytest.mark.parametrize(
    "ground",
    [
        {"profile": {"at": [0.0, 0.5], "friction": [1.0, 1.5]}},
        {"walls": [{"at": 0.32, "stops": "forward"}]},
        {"patches": [{"from": 0.25, "to": 0.3, "friction": 0.6}]},
    ],
    ids=["profile", "wall", "patch"],
)
def test_where_the_ground_differs_from_place_to_place_the_first_periods_count(ground):
    known, scene = posterior(0.01), robot(ground=ground)
    found = predict(scene, known, periods=3)
    drawn = known.draw(np.random.default_rng(1), 200)
    gains = [
        simulate(one, 3.0).net_translation[-1]
        for one in Variations(scene, dict(zip(NAMES, drawn.T, strict=True)), (200,))
    ]
    assert found.run_gain.high - found.run_gain.low == pytest.approx(width(np.array(gains)), rel=0.2)
    assert found.gain.value == pytest.approx(simulate(scene, 3.0).per_period.mean(), abs=1e-12)
    assert found.gain.high == pytest.approx(found.run_gain.high / 3.0)


@pytest.mark.parametrize("least", [0.1, 0.25, 0.4])
@pytest.mark.parametrize("beyond", [1.0, 1.7, 2.6, 8.0])
def test_where_a_bounded_contact_slides_the_band_covers_all_that_its_bound_allows(least, beyond):
    known = posterior(0.005, without=(LEFT,), bounds={LEFT: (least, None)})
    found = predict(robot(), known, periods=2)
    truth = limit_cycle(varied(robot(), {LEFT: least * beyond}))
    assert found.gain.low <= truth.gain <= found.gain.high
    assert found.energy.low <= truth.work <= found.energy.high
    (one,) = found.depends_on_bounds
    assert one.name == LEFT
    assert one.why == (
        f"contact 0 slides backwards under this drive; the record shows only that its friction is at least {least:g} N:"
        " the band covers all values beyond"
    )


def test_several_bounded_contacts_are_covered_together():
    names = (LEFT, "friction.backward[1]")
    known = posterior(0.005, without=names, bounds=dict.fromkeys(names, (0.1, None)))
    found = predict(robot(), known, periods=2)
    assert {one.name for one in found.depends_on_bounds} == set(names)
    for values in np.random.default_rng(3).uniform(0.1, 1.5, (20, 2)):
        truth = limit_cycle(varied(robot(), dict(zip(names, values.tolist(), strict=True))))
        assert found.gain.low <= truth.gain <= found.gain.high


def test_a_bound_far_from_what_the_drive_does_changes_nothing():
    held = posterior(without=(LEFT,), bounds={LEFT: (0.55, None)})
    found = predict(robot(), held)
    assert found.depends_on_bounds == ()
    assert found.gain.high == pytest.approx(predict(robot(), posterior(without=(LEFT,))).gain.high)


def test_a_limit_that_the_record_did_not_reach_widens_the_band_where_the_drive_reaches_it():
    body = {"contacts": [0.0, 0.1], "links": {"stiffness": 10.0, "tension": {"most": 0.4, "least": -0.4}}}
    drive = {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[0.0], [0.1], [0.0]]}
    friction = {"forward": [0.2, 0.2], "backward": [0.6, 0.6]}
    scene = Scene.model_validate({"name": "motor", "body": body, "friction": friction, "drive": drive})
    most = "body.links.tension.most"
    known = Posterior(("friction.forward[0]",), np.array([0.2]), np.array([[1e-6]]), bounds={most: (0.15, None)})
    found = predict(scene, known)
    assert [one.name for one in found.depends_on_bounds] == [most]
    assert f"depends on {most}; the record shows only that it is at least 0.15" in found.depends_on_bounds[0].why
    for value in (0.15, 0.19, 0.3):
        truth = float(limit_cycle(varied(scene, {most: value})).gain)
        assert found.gain.low - 1e-12 <= truth <= found.gain.high + 1e-12
    assert predict(scene, dataclasses.replace(known, bounds={most: (0.3, None)})).depends_on_bounds == ()


def test_what_a_record_bounds_is_predicted_for_a_drive_under_which_it_slides():
    """The scene guesses twice the friction that held, so that the best values by themselves would miss the truth."""
    document = chain(3)
    document["friction"]["backward"] = [0.4, 0.6, 0.4]
    measured = measure(document, *walk(2, 6.0, 0, stroke=0.015), noise=2e-4)
    keys = ["friction.forward", "friction.backward"]
    found = identify(scaled(document, {"friction.backward": 2.0}), [measured], keys, hold_out=0.0)
    fitted = [p for p in found.parameters if p.verdict == "identified"]
    assert {p.name for p in found.parameters if p.verdict == "bound"} == set(NAMES[3:])
    deviations = np.array([(p.interval[1] - p.interval[0]) / 3.92 for p in fitted])
    known = Posterior(tuple(p.name for p in fitted), np.array([p.value for p in fitted]), np.diag(deviations**2))
    forecast = predict(found.scene, found.summary() | {"posterior": known.as_plain()}, PERIODIC)
    truth = limit_cycle(Scene.model_validate(document | {"drive": PERIODIC})).gain
    assert forecast.gain.low <= truth <= forecast.gain.high
    alone = predict(found.scene, known, PERIODIC)
    assert not alone.gain.low <= truth <= alone.gain.high


@pytest.mark.parametrize("gain", [Prior(0.0, 0.02), Prior(0.03, 0.0)])
@pytest.mark.parametrize("recordings", [1, 2])
def test_the_gain_of_the_actuators_moves_predictions_and_what_is_played_back(gain, recordings):
    """Without it, the gain of a period is short of the truth by five per cent, several times its band."""
    document, factor = chain(3), 1.03
    measured = []
    for k in range(10, 10 + recordings):
        times, rows = walk(2, 6.0, k)
        moved = measure(document, times, factor * rows, noise=1e-4, seed=k)
        measured.append(dataclasses.replace(moved, commands=rows))
    sensor = Sensor(scale=Prior(0.0, 0.0), gain=gain)
    guess = scaled(document, {"friction.forward": 1.3})
    found = identify(guess, measured, ["friction.forward"], hold_out=0.0, sensor=sensor)
    assert found.posterior.names == (*NAMES[:3], "gain")
    again = read_posterior(json.loads(json.dumps(found.summary())), guess)
    assert again.gain == pytest.approx(0.03, abs=2e-3)
    assert set(again.draw_bodies(np.random.default_rng(0), 2)) == set(NAMES[:3])
    truth = limit_cycle(Scene.model_validate(document | {"drive": scale_drive(PERIODIC, factor)})).gain
    forecast = predict(guess, again, PERIODIC)
    assert forecast.gain.low < truth < forecast.gain.high
    alone = predict(guess, dataclasses.replace(found.posterior, values=[*found.posterior.values[:3], 0.0]), PERIODIC)
    assert not alone.gain.low < truth < alone.gain.high
    own = predict(found.playback(), again)
    assert own.run_gain.value == pytest.approx(simulate(found.playback(), 6.0).net_translation[-1], abs=1e-9)
    assert "the drive of the scene is taken to have the lengths that the actuators reach" in own.notes[0]
    played = simulate(found.playback(), 6.0, 50.0)
    np.testing.assert_allclose(np.diff(played.displacement), np.diff(measured[0].values) - 0.1, atol=1e-3)


def test_gains_that_contradict_each_other_widen_the_posterior_and_each_belongs_to_its_recording():
    """Tables in different folders may have the same name."""
    document, measured = chain(3), []
    for k, factor in enumerate((1.02, 1.06)):
        times, rows = walk(2, 6.0, k)
        moved = measure(document, times, factor * rows, noise=1e-4, seed=k)
        measured.append(dataclasses.replace(moved, name="run.csv", commands=rows))
    sensor = Sensor(scale=Prior(0.0, 0.0), gain=Prior(0.0, 0.05))
    found = identify(Scene.model_validate(document), measured, ["friction.forward"], sensor=sensor)
    for k, factor in enumerate((1.02, 1.06)):
        played = np.abs(found.playback(k).drive.rows[:, :2]).max() / np.abs(measured[k].commands).max()
        assert played == pytest.approx(factor, abs=5e-3)
    known = found.posterior
    assert known.gain == pytest.approx(0.04, abs=5e-3)
    assert 0.01 < np.sqrt(known.covariance[-1, -1]) < 0.04


def test_the_gain_multiplies_all_lengths_of_a_drive():
    """Gains are homogeneous: whatever kind of drive, lengths and forces of twice the size move twice as far."""
    strategy = load_scene("two_anchor_a").document()
    wave = load_scene("ten_contact_wave").document()
    for document in (strategy, wave):
        twice = copy.deepcopy(document) | {"drive": scale_drive(document["drive"], 2.0)}
        for part in [twice["friction"]] if "friction" in twice else []:
            part.update({side: (2.0 * np.array(value)).tolist() for side, value in part.items()})
        if "start" in twice:
            twice["start"]["displacement"] = [2.0 * x for x in twice["start"]["displacement"]]
        if "friction" in twice["drive"]:
            twice["drive"]["friction"] = 2.0 * twice["drive"]["friction"]
        one, other = (simulate(Scene.model_validate(each), 1.0).displacement for each in (document, twice))
        np.testing.assert_allclose(other, 2.0 * one, atol=1e-12)


def test_a_bound_beyond_which_the_motion_never_stops_to_change_says_how_far_it_was_followed():
    known = posterior(bounds={"body.links.stiffness[0]": (10.0, None)})
    (one,) = predict(robot(), known, periods=1).depends_on_bounds
    assert one.why.endswith("at least 10: the band covers all values beyond, up to 100 times")


@pytest.mark.parametrize(("value", "refused"), [(0.2, True), (0.9, True), (5.0, False)])
def test_a_motion_that_depends_on_what_was_not_excited_is_refused(value, refused):
    known = posterior(without=(LEFT,), unknown=(LEFT,))
    friction = {"forward": list(FORWARD), "backward": [value, *BACKWARD[1:]]}
    scene = robot(friction=friction)
    if not refused:
        assert predict(scene, known, periods=1).gain.low < predict(scene, known, periods=1).gain.high
        return
    with pytest.raises(CrawlerError, match=r"depends on friction\.backward\[0\], which the record did not excite"):
        predict(scene, known, periods=1)


def test_ratios_predict_the_gain_and_a_note_tells_what_the_energy_holds_for():
    stiffness = tuple(f"body.links.stiffness[{j}]" for j in range(2))
    one = posterior()
    names = (*one.names, stiffness[1])
    covariance = np.diag((0.02 * np.array([*one.values, 10.0])) ** 2)
    known = Posterior(
        names, np.array([*one.values, 10.0]), covariance, held={stiffness[0]: 10.0}, groups=((*names, stiffness[0]),)
    )
    found = predict(robot(), known)
    assert found.notes == (f"the energy holds for {stiffness[0]} = 10: the record determines only ratios",)
    assert read_posterior(printed(known)).held == {stiffness[0]: 10.0}


@pytest.mark.parametrize(("stroke", "kinks"), [(0.025, 0), (0.026, 1), (0.027, 0)])
def test_a_note_tells_where_bands_belong_to_one_side_of_a_kink(stroke, kinks):
    """Contact 2 is at its bound when the drive ends: with less friction it would have slid."""
    drive = {"times": [0.0, 1.0], "actuation": [[0.0, 0.0], [0.0, stroke]]}
    found = predict(robot(drive), posterior())
    assert len([note for note in found.notes if "has a kink at the value of friction.forward[2]" in note]) == kinks


def test_a_posterior_is_read_as_it_is_written(tmp_path):
    known = posterior(
        without=(LEFT, NAMES[4]),
        bounds={LEFT: (0.25, None)},
        unknown=(NAMES[4],),
        held={"body.links.stiffness[0]": 10.0},
        groups=(("body.links.stiffness[0]", *NAMES[:2]),),
    )
    file = tmp_path / "fit.json"
    file.write_text(json.dumps(printed(known)), encoding="utf-8")
    again = read_posterior(file, robot())
    for name in ("names", "bounds", "held", "unknown"):
        assert getattr(again, name) == getattr(known, name)
    assert set(again.groups[0]) == set(known.groups[0])
    np.testing.assert_array_equal(again.values, known.values)
    np.testing.assert_array_equal(again.covariance, known.covariance)


def test_the_file_of_another_body_is_named(tmp_path):
    file = tmp_path / "fit.json"
    file.write_text(json.dumps(printed(posterior())), encoding="utf-8")
    said = "its values do not fit planar_three_points: friction: in the plane use `isotropic`"
    with pytest.raises(CrawlerError, match=f"^{file}: {said}"):
        predict("planar_three_points", file)
    with pytest.raises(CrawlerError, match=f"^posterior: {said}"):
        predict("planar_three_points", posterior())


def test_a_body_that_does_not_move_gains_exactly_nothing():
    still = PERIODIC | {"actuation": [[0.0, 0.0]] * len(PERIODIC["times"])}
    found = predict(robot(), posterior(), still)
    assert (found.gain.value, found.gain.low, found.gain.high, found.transient_left) == (0.0, 0.0, 0.0, 0.0)


def test_a_prediction_is_plain_json():
    known = posterior(without=(LEFT,), bounds={LEFT: (0.25, None)})
    text = json.loads(json.dumps(predict(robot(), printed(known)).summary(), allow_nan=False))
    assert text["schema"] == 1
    assert text["gain"]["low"] < text["gain"]["value"] <= text["gain"]["high"]
    assert text["energy"]["unit"] == "J"
    assert text["run"]["periods"] == 10
    assert text["positions"]["contacts"] == ["contact 0", "contact 1", "contact 2"]
    assert len(text["positions"]["low"]) == len(text["positions"]["time"])
    assert text["depends_on_bounds"][0]["interval"] == [0.25, None]


def test_draws_have_the_covariance_and_keep_positive_numbers_positive():
    known = posterior(0.3)
    drawn = known.draw(np.random.default_rng(0), 40_000)
    assert (drawn > 0.0).all()
    logs = np.cov(np.log(drawn).T)
    np.testing.assert_allclose(logs, known.covariance / np.outer(known.values, known.values), atol=2e-3)
    offset = Posterior(("start.displacement[0]",), np.array([1e-4]), np.array([[1e-2]]))
    assert (offset.draw(np.random.default_rng(0), 100) < 0.0).any()


def test_bands_are_wider_if_the_noise_follows_from_few_numbers():
    sure, unsure = (predict(robot(), posterior(freedom=freedom)) for freedom in (np.inf, 5.0))
    assert sure.gain.high - sure.gain.value == pytest.approx(
        (unsure.gain.high - unsure.gain.value) * 1.95996 / 2.57058, rel=1e-4
    )
    assert read_posterior(printed(posterior(freedom=5.0))).freedom == 5.0
    assert read_posterior(printed(posterior())).freedom == np.inf
    with pytest.raises(CrawlerError, match="posterior: freedom: 0; it must be at least 1"):
        posterior(freedom=0.0)


def test_an_identification_knows_its_posterior():
    truth = chain()
    measured = measure(truth, *walk(2, 6.0, 3), noise=1e-4)
    found = identify(scaled(truth, {"friction.forward": 1.1}), [measured], ["friction.forward"], hold_out=0.0)
    written = read_posterior(found.summary())
    assert written.names == found.posterior.names
    np.testing.assert_array_equal(written.covariance, found.posterior.covariance)
    assert written.freedom == measured.values.size + 2 + 3 - 5  # with priors of lag, scale and three drifts
    assert found.scene == written.apply(found.scene)


def test_the_scene_gets_the_values_and_stays_within_bounds():
    known = posterior(without=(LEFT,), bounds={LEFT: (0.8, None)})
    changed = known.apply(varied(robot(), {NAMES[0]: 0.4}))
    assert changed.drive.forward[0] == pytest.approx(FORWARD)
    assert changed.drive.backward[0] == pytest.approx((1.25 * 0.8, *BACKWARD[1:]))  # clear of its bound


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": 2}, "schema: 2; it must be 1"),
        ({"posterior": None}, "no posterior; print it with `crawler identify --json`"),
        ({"posterior": {"names": ["friction.forward[0]"]}}, "it must have names, values and covariance"),
        (
            {"posterior": {"names": ["friction.forward[0]"], "values": [1.0, 2.0], "covariance": [[1.0]]}},
            r"values: shape \(2,\); it must be \(1,\)",
        ),
        (
            {"posterior": {"names": ["friction.forward[0]"], "values": [1.0], "covariance": [[-1.0]]}},
            r"the variance of friction.forward\[0\] is -1; it must be >= 0",
        ),
        (
            {"posterior": {"names": ["friction.forward[0]"], "values": [1.0], "covariance": [[float("nan")]]}},
            r"covariance\[0, 0\]: nan; it must be finite",
        ),
        (
            {"posterior": {"names": list(NAMES[:2]), "values": [1.0, 1.0], "covariance": [[1.0, 0.5], [0.0, 1.0]]}},
            r"\[0\]\[1\] is 0.5 and \[1\]\[0\] is 0; it must be symmetric",
        ),
        (
            {"posterior": {"names": list(NAMES[:2]), "values": [1.0, 1.0], "covariance": [[1.0, 2.0], [2.0, 1.0]]}},
            "an eigenvalue of the correlations is -1; it must be positive semidefinite",
        ),
        (
            {"posterior": {"names": ["friction.forwards[0]"], "values": [1.0], "covariance": [[1.0]]}},
            r"friction.forwards\[0\]: robot has no such number",
        ),
        (
            {"parameters": [{"name": LEFT, "verdict": "bound", "value": 1.0, "interval": [None, None]}]},
            "one end of a bound must be a number",
        ),
        (
            {"parameters": [{"name": LEFT, "verdict": "bound", "value": 1.0, "interval": [2.0, 1.0]}]},
            r"interval \[2, 1\]; the lower end must come first",
        ),
        (
            {"parameters": [{"name": NAMES[0], "verdict": "not excited", "value": None, "interval": [None, None]}]},
            r"friction.forward\[0\] is named twice",
        ),
    ],
)
def test_what_is_no_posterior_is_refused_in_one_line(change, message):
    with pytest.raises(CrawlerError, match=message) as refused:
        read_posterior(printed(posterior()) | change, robot())
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"drive": EXCITING, "periods": 3}, "periods: 3; the drive has no period"),
        ({"periods": 0}, "periods: 0; it must be between 1 and 10000"),
        (
            {"drive": {"times": [0.0, 1.0], "actuation": [[0.0], [1.0]]}},
            "the drive does not fit robot: drive.actuation",
        ),
        ({"drive": robot(None)}, "robot has no drive"),
        ({"drive": "nothing"}, "nothing: no such file, nor a scene of the gallery"),
    ],
)
def test_a_drive_that_does_not_fit_is_refused(given, message):
    with pytest.raises(CrawlerError, match=message):
        predict(robot(), posterior(), **given)


def test_a_scene_without_a_start_begins_relaxed_where_the_drive_would_pull_it_away():
    document = robot(None).document()
    del document["start"]
    pulling = {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[0.1, 0.1], [0.0, 0.0], [0.1, 0.1]]}
    found, expected = (predict(scene, posterior(), pulling) for scene in (Scene.model_validate(document), robot(None)))
    assert (found.gain.value, found.gain.low) == (expected.gain.value, expected.gain.low)
    with pytest.raises(CrawlerError, match="the drive does not fit robot: start"):
        predict(robot(None, start={"displacement": [0.0, 0.0, 0.0]}), posterior(), pulling)


def test_numbers_that_the_drive_commands_have_no_effect():
    friction = {"forward": [FORWARD] * 5, "backward": [BACKWARD] * 5}
    found = predict(robot(), posterior(), PERIODIC | {"friction": friction})
    assert found.gain.low == pytest.approx(found.gain.high, abs=1e-9)
