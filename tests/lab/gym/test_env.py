"""The single environment: what Gymnasium expects, what the model says, and what is refused."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
import warnings

import numpy as np
import pytest

pytest.importorskip("gymnasium")
import gymnasium
from gymnasium.utils.env_checker import check_env

import crawler_lab.gym
from crawler_model import CommandError, Crawler, CrawlerError, Scene, load_scene

from .scenes import CHAIN, EACH_KIND, KINDS, act, chain, varied


def make(scene="three_contacts_one_way", task="translation", **settings):
    return gymnasium.make("crawler_lab/Crawler-v0", scene=scene, task=task, **settings).unwrapped


def of_kind(kind: str, **settings):
    build, needed = KINDS[kind]
    return make(build(), **{**needed, **settings})


def play(env, steps: int, seed: int | None = None, **given):
    """Observations, rewards and infos of an episode."""
    observation, info = env.reset(seed=seed, **given)
    seen, rewards, infos = [observation], [], [info]
    for step in range(steps):
        observation, reward, terminated, truncated, info = env.step(act(observation, env.action_space.shape[0], step))
        assert env.observation_space.contains(observation)
        seen.append(observation)
        rewards.append(reward)
        infos.append(info)
        if terminated or truncated:
            break
    return np.array(seen), np.array(rewards), infos


NOISE = {"randomise": {"noise": 0.01}}
TASKS = {
    "translation": ("three_contacts_one_way", NOISE),
    "speed": ("three_contacts_one_way", NOISE),
    "reach": ("three_contacts_one_way", NOISE),
    "climb": ("slope_climber", NOISE),
    "steer": ("steering_inchworm", {}),
    "steer by heading": ("steering_inchworm", {"heading": 1.0}),
}


@pytest.mark.filterwarnings("ignore:.*no display here")
@pytest.mark.parametrize("name", TASKS)
def test_gymnasium_finds_nothing_to_complain_about(name):
    pytest.importorskip("matplotlib").use("agg")
    scene, settings = TASKS[name]
    env = make(scene, name.split()[0], **settings)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warnings.simplefilter("ignore", ResourceWarning)  # of earlier tests, whose files are collected meanwhile
        check_env(env)
    assert [str(w.message) for w in caught if "no display" not in str(w.message)] == []


@pytest.mark.parametrize("kind", EACH_KIND)
def test_the_path_is_that_of_the_model(kind):
    """The crawler that follows the commands in force sees the same forces and elongations, to the bit."""
    env = of_kind(kind)
    env.reset(seed=1)
    crawler = Crawler(env.spec_of_crawler.scene)
    observation = np.zeros(1)
    joints = crawler.joint_elongation.size
    moved = 0.0
    for step in range(40):
        observation, *_ = env.step(act(observation, env.action_space.shape[0], step))
        crawler.follow(crawler.scene.columns.target(env.lanes.row(0))[None])
        assert np.array_equal(env.displacement, crawler.displacement)
        assert np.array_equal(observation[:joints], crawler.joint_elongation.ravel())
        assert np.array_equal(observation[joints : 2 * joints], crawler.joint_tension.ravel())
        moved = max(moved, np.abs(crawler.gained).max())
    assert moved > 0.0


def test_tensions_are_bounded_by_the_loads_in_force():
    """Those at the start of the drive, which pull the contacts together here; later ones are not played."""
    drive = {"times": [0, 1, 2], "period": 2.0, "actuation": [[0.0], [0.1], [0.0]]}
    drive["loads"] = [[0.4, -0.4], [0.0, 0.0], [0.4, -0.4]]
    env = make(chain(2, loads=0.0, friction={"forward": 0.5, "backward": 0.5}, drive=drive), rate=5.0)
    env.reset()
    crawler = Crawler(env.spec_of_crawler.scene)
    for _ in range(2):
        observation, *_ = env.step(np.ones(1))
        crawler.follow(crawler.scene.columns.target(env.lanes.row(0))[None])
    assert observation[1] == crawler.joint_tension[0] == pytest.approx(-0.9)


def test_tensions_are_bounded_by_the_friction_of_the_most_level_ground():
    body = {"contacts": [0.0, 0.2], "links": {"stiffness": 20.0}, "weights": 1.0}
    document = {"name": "steep", "body": body, "friction": {"coefficient": {"forward": 5.0, "backward": 5.0}}}
    document["ground"] = {"slope": 75.0}
    env = make(Scene.model_validate(document), randomise={"slope": 0.0}, stroke=[0.0, 1.0])
    env.reset()
    for _ in range(4):
        observation, *_ = env.step(np.ones(1))
    assert observation[1] == pytest.approx(-5.0)


def test_tensions_are_bounded_between_walls_where_friction_does_not_hold_them():
    walls = [{"at": -0.01, "stops": "backward"}, {"at": 0.21, "stops": "forward"}]
    drive = {"times": [0, 1, 2], "period": 2.0, "actuation": [[0.0, 0.0], [0.1, 0.1], [0.0, 0.0]]}
    env = make(chain(friction={"forward": 0.01, "backward": 0.01}, ground={"walls": walls}, drive=drive))
    env.reset(seed=1)
    for _ in range(10):
        observation, *_ = env.step(np.ones(2))
        assert env.observation_space.contains(observation)
    assert np.abs(observation[2:4]).min() > 1.0  # both springs push, with k (2 D - room) / 2


CURVE = {"elongation": [-0.1, 0.0, 0.1], "tension": [-0.5, 0.0, 5.0]}
STOPS = {"shortest": -0.02, "longest": 0.02, "stiffness": 60.0}
BENT = {
    "limits": {"stiffness": 20.0, "tension": {"least": 0.0, "most": 0.05}},
    "curve": {"curve": CURVE},
    "hysteresis": {"stiffness": 20.0, "hysteresis": [{"stiffness": 40.0, "yield": 0.5}]},
    "stops": {"stiffness": 5.0, "passive": {"stiffness": 0.0, "stops": STOPS}},
    "backlash": {"stiffness": 20.0, "backlash": 0.02},
}


@pytest.mark.parametrize("spring", BENT)
def test_no_bound_cuts_the_elongation_of_a_spring_that_bends(spring):
    """The bound of a linear spring of the same stiffness cut what was observed."""
    friction = {side: [1.0, 0.1, 1.0] for side in ("forward", "backward")}
    body = {"contacts": [0.0, 0.2, 0.4], "links": [BENT[spring], {"stiffness": 20.0}]}
    drive = {"times": [0, 1, 2, 3], "period": 3.0, "actuation": [[0, 0], [0.01, -0.1], [-0.01, 0.1], [0, 0]]}
    env = make(Scene.model_validate({"name": spring, "body": body, "friction": friction, "drive": drive}))
    rng = np.random.default_rng(0)
    for hold in (1, 2, 4):
        env.reset(seed=0)
        for action in np.sign(rng.normal(size=(60 // hold, 2))).repeat(hold, axis=0):
            observation, *_ = env.step(action)
            assert observation[:2] == pytest.approx(np.diff(env.displacement), abs=1e-12)
    assert np.isinf(env.observation_space.high[0]) == (spring == "limits")


def test_no_bound_cuts_a_tension_where_ground_holds_more_and_loads_pull():
    friction = {"forward": [2.0, 0.05], "backward": [2.0, 0.4]}
    drive = {"times": [0, 1, 2, 3], "period": 3.0, "actuation": [[0], [0.1], [-0.1], [0]]}
    ground = {"patches": [{"from": -5.0, "to": 5.0, "friction": 3.0}]}
    body = {"contacts": [0.0, 0.2], "links": {"stiffness": 20.0}}
    scene = {"name": "loaded", "body": body, "friction": friction, "loads": [0.0, -0.1], "ground": ground}
    env = make(Scene.model_validate(scene | {"drive": drive}))
    env.reset(seed=0)
    seen = []
    for step in range(20):
        observation, *_ = env.step(np.array([(-1.0) ** (step // 4)]))
        assert observation[1] == pytest.approx(20.0 * (observation[0] - env.lanes.row(0)[0]), abs=1e-12)
        seen.append(observation[1])
    assert max(np.abs(seen)) > 1.05


@pytest.mark.parametrize("kind", EACH_KIND)
def test_same_seed_same_bits(kind):
    options = {"noise": 0.02, "delay": [0, 2], "stiffness": [0.8, 1.0]}
    runs = [play(of_kind(kind), 15, seed=5, options=options) for _ in range(2)]
    other = play(of_kind(kind), 15, seed=6, options=options)
    assert np.array_equal(runs[0][0], runs[1][0])
    assert np.array_equal(runs[0][1], runs[1][1])
    assert not np.array_equal(runs[0][0], other[0])


def test_gains_are_those_of_the_net_translation():
    seen, rewards, infos = play(make(price=0.0), 60, seed=0)
    assert rewards.sum() == pytest.approx(infos[-1]["net_translation"], abs=1e-14)
    assert infos[-1]["net_translation"] > 0.05
    back = play(make(price=0.0, direction=-1), 60, seed=0)[2]
    assert back[-1]["net_translation"] < 0.0
    furthest = np.maximum.accumulate([info["net_translation"] for info in infos])
    behind = furthest - [info["net_translation"] for info in infos]
    assert seen[:, -1] == pytest.approx(behind, abs=1e-15)


def test_work_has_its_price():
    free, paid = (play(make(price=price), 30, seed=0) for price in (0.0, 0.5))
    force = 0.5 * 3 * (0.2 + 0.5)
    work = np.array([info["work"] for info in free[2][1:]])
    assert free[1] - paid[1] == pytest.approx(0.5 * work / force, abs=1e-15)
    crawler = Crawler(load_scene("three_contacts_one_way"))
    env = make()
    env.reset(seed=0)
    total = 0.0
    for step in range(10):
        *_, info = env.step(act(np.zeros(2), 2, step))
        total += crawler.advance(env.lanes.row(0)[:2]).work - info["work"]
    assert total == 0.0


def test_a_speed_is_rewarded_up_to_that_speed():
    """What is gained sums to the distance that counts: all of it while behind, none of what is ahead."""
    env = make(task="speed", speed=0.02, price=0.0)
    seen, rewards, infos = play(env, 60, seed=0)
    elapsed = len(rewards) / 20.0
    gone = infos[-1]["net_translation"]
    assert rewards.sum() == pytest.approx(0.02 * elapsed - abs(0.02 * elapsed - gone), abs=1e-13)
    assert seen[-1, -1] == pytest.approx(0.02 * elapsed - gone, abs=1e-14)


def test_a_place_is_reached_to_its_tolerance():
    env = make(task="reach", place=0.03, tolerance=0.005, price=0.0)
    seen, rewards, infos = play(env, 200, seed=0)
    assert len(rewards) < 200
    assert abs(seen[-1, -1]) <= 0.005 < abs(seen[-2, -1])
    assert rewards.sum() == pytest.approx(0.03 - abs(seen[-1, -1]), abs=1e-14)
    assert infos[-1]["net_translation"] == pytest.approx(0.03, abs=0.005)


def test_an_episode_is_cut_off_after_its_steps():
    env = make(steps=3)
    env.reset(seed=0)
    assert [env.step(np.zeros(2))[3] for _ in range(3)] == [False, False, True]


def test_actions_move_the_commands_at_their_largest_rate_and_no_further():
    env = make(stroke_time=0.5)  # ten steps
    env.reset(seed=0)
    env.step(np.array([0.5, 7.0]))
    assert env.lanes.row(0)[:2] == pytest.approx([0.005, 0.01])
    for _ in range(20):
        env.step(np.array([0.0, 1.0]))
    assert env.lanes.row(0)[:2] == pytest.approx([0.005, 0.1])


def test_friction_is_free_where_the_drive_commands_it_or_bounds_are_given():
    assert make("two_anchor_a").action_names == ("link_0", "contact_0/friction", "contact_1/friction")
    env = make(friction=[0.1, 0.6])
    assert env.action_names[2:] == tuple(f"contact_{i}/friction" for i in range(3))
    env.reset(seed=0)
    env.step(np.array([0.0, 0.0, 1.0, -1.0, 0.0]))
    row = env.lanes.row(0)[2:]
    assert row == pytest.approx([0.3, 0.1, 0.2, 0.6, 0.4, 0.5])


def test_a_delay_holds_actions_back():
    late, prompt = make(), make()
    late.reset(seed=0, options={"delay": 2})
    prompt.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1, 1, (12, 2))
    rows = []
    for env in (late, prompt):
        rows.append([])
        for action in actions:
            env.step(action)
            rows[-1].append(env.lanes.row(0))
    assert np.array_equal(rows[0][2:], rows[1][:-2])
    assert np.array_equal(rows[0][1], env.spec_of_crawler.scene.drive.rows[0])


def test_noise_is_normal_and_does_not_touch_the_path():
    clear, noisy = make(), make()
    clear.reset(seed=0)
    noisy.reset(seed=0, options={"noise": 0.05})
    errors = []
    for step in range(199):
        action = act(np.zeros(1), 2, step)
        errors.append(noisy.step(action)[0] - clear.step(action)[0])
    assert np.array_equal(clear.displacement, noisy.displacement)
    scaled = np.array(errors) / noisy.spec_of_crawler.spans.scale / 0.05
    count = np.sqrt(scaled.size)
    assert abs(scaled.mean()) < 4.0 / count
    assert abs(scaled.std() - 1.0) < 4.0 / count


def test_an_episode_repeats_from_its_info():
    ranges = {"friction": [0.8, 1.2], "stiffness": [0.5, 2.0], "loads": [-0.02, 0.02], "slope": [-2.0, 5.0]}
    ranges |= {"delay": [0, 4], "noise": [0.0, 0.1]}
    env = make(varied(), randomise=ranges)
    first = play(env, 30, seed=11)
    second = play(env, 30)
    assert not np.array_equal(first[0], second[0])
    drawn = first[2][0]["drawn"]
    assert set(drawn) == {*ranges, "noise_seed"}
    again = play(make(varied()), 30, seed=99, options=drawn)
    assert np.array_equal(first[0], again[0])
    document = CHAIN | {"loads": drawn["loads"], "ground": {"slope": drawn["slope"]}}
    document["friction"] = {
        "forward": [f * drawn["friction"] for f in (0.2, 0.25, 0.2)],
        "backward": [0.5 * drawn["friction"]] * 3,
    }
    stiffness = [k * drawn["stiffness"] for k in (20.0, 25.0)]
    document["body"] = CHAIN["body"] | {"links": {"stiffness": stiffness}}
    crawler = Crawler(Scene.model_validate(document))
    env = make(varied())
    env.reset(options=drawn)
    for step in range(20):
        env.step(act(np.zeros(1), 2, step))
        crawler.follow(crawler.scene.columns.target(env.lanes.row(0))[None])
        assert np.array_equal(env.displacement, crawler.displacement)


SPRINGS = {
    "alike": {"stiffness": 20.0},
    "listed": [{"stiffness": 20.0}, {"stiffness": 25.0}],
    "limited": [
        {"stiffness": 8.0, "tension": 0.5, "passive": {"stiffness": 2.0}},
        {"stiffness": 8.0, "passive": {"stops": {"longest": 0.05, "stiffness": 100.0}}},
    ],
    "curved": {"curve": {"elongation": [-0.1, 0.0, 0.1], "tension": [-1.0, 0.0, 3.0]}},
}


@pytest.mark.parametrize("springs", SPRINGS)
def test_a_factor_on_stiffness_is_one_on_all_forces(springs):
    """Springs twice as stiff, with limits twice as large, go the same way on twice the friction."""
    links = SPRINGS[springs]
    weak = [link | {"tension": 0.25} if "tension" in link else link for link in links] if type(links) is list else links
    stiff, soft = (
        make(chain(body={"contacts": [0.0, 0.1, 0.2], "links": each}, friction={"forward": f, "backward": 0.5 * f}))
        for each, f in ((links, 0.4), (weak, 0.2))
    )
    stiff.reset(options={"stiffness": 2.0})
    soft.reset()
    for step in range(20):
        for env in (stiff, soft):
            env.step(act(np.zeros(1), 2, step))
        assert stiff.displacement == pytest.approx(soft.displacement, abs=1e-12)
    assert np.abs(soft.displacement).max() > 0.01


def test_friction_is_randomised_on_a_profile():
    """A factor on friction stands for the same factor on all factors of the profile."""
    document = load_scene("leaving_ice").document()
    document["ground"]["profile"]["friction"] = [0.5 * factor for factor in document["ground"]["profile"]["friction"]]
    env, other = make("leaving_ice"), make(Scene.model_validate(document))
    env.reset(seed=1, options={"friction": 0.5})
    other.reset(seed=1)
    for step in range(60):
        seen, wanted = (one.step(np.array([np.sin(0.4 * step)]))[0] for one in (env, other))
        assert seen == pytest.approx(wanted, abs=1e-12)
    assert abs(env.displacement).max() > 0.05


@pytest.mark.parametrize("scene", ["slope_climber", "hill_top", "planar"])
def test_a_slope_may_be_level(scene):
    """A scene that only its slope loads has commands of loads without that slope, too."""
    if scene == "planar":
        body = {"contacts": [[0.0, 0.0], [0.2, 0.0]], "links": {"stiffness": 20.0}, "weights": 1.0}
        document = {"name": scene, "dimension": 2, "body": body, "friction": {"coefficient": {"isotropic": 0.5}}}
    else:
        document = load_scene(scene).document()
    document.setdefault("ground", {})["slope"] = 1.0
    env = make(Scene.model_validate(document), direction=1)
    play(env, 5, options={"slope": 0.0})
    crawler = Crawler(env.lanes.scene({"slope": 0.0}))
    env.reset()
    for _ in range(5):
        env.step(np.ones(env.action_space.shape))
        crawler.follow(crawler.scene.columns.target(env.lanes.row(0))[None])
    assert np.array_equal(env.displacement, crawler.displacement)
    assert not crawler.loads.any()


def test_a_command_that_friction_cannot_hold_is_not_followed():
    env = make(chain(loads=-0.3), friction=[0.1, 0.6])
    env.reset(seed=0)
    for _ in range(30):
        env.step(np.array([0.0, 0.0, -1.0, -1.0, -1.0]))
    assert env.lanes.row(0)[5:8].sum() >= 0.9 * (1 - 1e-9)


@pytest.mark.parametrize(
    ("slope", "ranges", "direction"),
    [
        (0.0, {"slope": [-10.0, -5.0]}, -1.0),
        (10.0, {"slope": [-10.0, -5.0]}, -1.0),
        (10.0, {"slope": [-9.0, 9.0]}, 1.0),
        (0.0, {"slope": [-9.0, 9.0]}, 1.0),
        (0.0, {"loads": [0.01, 0.02]}, -1.0),
        (10.0, {"loads": [0.01, 0.02]}, 1.0),
    ],
)
def test_a_climb_goes_against_what_is_drawn_in_the_mean(slope, ranges, direction):
    document = load_scene("slope_climber").document() | {"ground": {"slope": slope}}
    env = make(Scene.model_validate(document), "climb", randomise=ranges)
    assert env.spec_of_crawler.task.direction == [direction]


def test_a_climb_over_a_hill_goes_the_way_that_the_ground_around_it_slopes():
    document = load_scene("hill_top").document()
    document["ground"]["slope"] = 1.0
    assert make(Scene.model_validate(document), "climb").spec_of_crawler.task.direction == [1.0]


@pytest.mark.parametrize("kind", ["chain", "segment", "plane"])
def test_it_draws_itself(kind, caplog):
    pytest.importorskip("matplotlib")
    env = of_kind(kind, render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    for step in range(20):
        env.step(act(np.zeros(1), env.action_space.shape[0], step))
    after = env.render()
    assert before.shape == after.shape == (192, 512, 3)
    assert before.dtype == np.uint8
    assert (before != after).any()
    assert not caplog.messages, "matplotlib warns"
    env.close()


def loaded_by(code: str) -> set[str]:
    code += "; import sys; print(' '.join({m.split('.')[0] for m in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return set(done.stdout.split())


def test_making_it_loads_neither_ros_nor_pictures():
    gymnasium.make(
        "crawler_lab.gym:crawler_lab/Crawler-v0"
    ).reset()  # else the other process reports that it compiles kernels
    made = loaded_by("import gymnasium; gymnasium.make('crawler_lab.gym:crawler_lab/Crawler-v0').reset()")
    assert not made & {"rclpy", "mcap", "matplotlib", "rerun"}


def hilly() -> Scene:
    """The chain on ground that gets steeper."""
    return Scene.model_validate(CHAIN | {"ground": {"profile": {"at": [0.2, 0.6], "slope": [0.0, 5.0]}}})


WRONG = [
    ({"task": "fly"}, "task: unknown task 'fly'; the nearest is "),
    ({"scene": "planar_three_points"}, "direction: missing; in the plane the task translation needs the angle"),
    ({"scene": "planar_three_points", "task": "reach"}, "place: missing; in the plane"),
    ({"task": "climb"}, "nothing loads three_contacts_one_way"),
    ({"direction": 0.5}, "direction: 0.5; on a line it must be 1 or -1"),
    ({"speed": 1.0}, "speed: 1.0, but the task is translation; only the task speed takes it"),
    ({"task": "speed", "speed": -1.0}, "speed: -1.0; it must be a number > 0 [m/s]"),
    ({"task": "reach", "place": [1.0, 2.0]}, "place: [1.0, 2.0]; it must be a finite number [m]"),
    ({"task": "reach", "tolerance": 0.0}, "tolerance: 0.0; it must be a number > 0 [m]"),
    ({"stroke": [0.1, 0.0]}, "stroke: [0.1, 0.0]; it must be two finite numbers [least, largest], in order"),
    ({"stroke": [0.05, 0.1]}, "stroke: link_0 is 0 at the start; the bounds 0.05 .. 0.1 must include it"),
    ({"friction": [-0.1, 1.0]}, "friction: [-0.1, 1.0]; friction must be >= 0"),
    ({"steps": -1}, "steps: -1; it must be a whole number, 0 .. "),
    ({"rate": 0.0}, "rate: 0 Hz"),
    ({"price": float("nan")}, "price: nan; it must be a number >= 0"),
    ({"stroke_time": True}, "stroke_time: True; it must be a number > 0 [s]"),
    ({"render_mode": "ascii"}, "render_mode: 'ascii'; it must be one of human, rgb_array, or None"),
    ({"scene": 7}, "Crawler-v0: 7; it must be a Scene, a path or a gallery name"),
    ({"randomise": {"mass": 1.0}}, "options: unknown key 'mass'; the nearest is "),
    (
        {"randomise": {"friction": [1.2, 0.8]}},
        "options: friction is [1.2, 0.8]; it must be a number or [least, largest]",
    ),
    (
        {"randomise": {"friction": 1.0}, "friction": [0.1, 0.6]},
        "options: friction cannot be randomised where it is free",
    ),
    (
        {"scene": hilly(), "randomise": {"slope": [0.0, 2.0]}},
        "options: slope: the ground.profile of chain sets all slopes; leave it out",
    ),
]


@pytest.mark.parametrize(("settings", "said"), WRONG, ids=[said[:40] for _, said in WRONG])
def test_wrong_settings_are_one_clear_line(settings, said):
    with pytest.raises(CrawlerError) as error:
        crawler_lab.gym.CrawlerEnv(**settings)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_loads_in_the_plane_are_not_randomised():
    scene = Scene.model_validate(load_scene("planar_three_points").document() | {"loads": 0.0})
    with pytest.raises(
        CrawlerError, match="options: loads is for bodies on a line; in the plane randomise slope or fri"
    ):
        crawler_lab.gym.CrawlerEnv(scene, direction=0.0).reset(options={"loads": 1.0})


WRONG_ACTIONS = [
    (np.zeros(3), r"action: shape \(3,\); it must be \(2,\)"),
    (0.5, r"action: shape \(\); it must be \(2,\)"),
    ("up", r"action: 'up'; it must be \(2,\) numbers"),
    ([0.0, np.nan], "action: link_1 is nan; it must be finite"),
    ([np.inf, 0.0], "action: link_0 is inf; it must be finite"),
]


@pytest.mark.parametrize(("action", "said"), WRONG_ACTIONS, ids=[said for _, said in WRONG_ACTIONS])
def test_a_wrong_action_leaves_the_state_untouched(action, said):
    env, other = make(), make()
    for one in (env, other):
        one.reset(seed=0)
        one.step(np.array([1.0, -0.5]))
    with pytest.raises(CommandError, match=said):
        env.step(action)
    follow = np.array([0.3, 0.9])
    assert np.array_equal(env.step(follow)[0], other.step(follow)[0])


WRONG_OPTIONS = [
    ({"frictoin": 1.0}, "options: unknown key 'frictoin'; the nearest is 'friction'"),
    ({"delay": 0.5}, "options: delay is 0.5; it must be a number or [least, largest], of whole numbers of steps"),
    ({"noise": -1.0}, "options: noise is -1.0"),
    ({"noise": "much"}, "options: noise is 'much'"),
    ({"slope": 5.0}, "ground.slope: no effect, as the contacts have no weights"),
    ({"loads": 1.0}, "options: with loads 1 the scene is invalid"),
    ("quiet", "options: 'quiet'; they must be a mapping"),
]


@pytest.mark.parametrize(("options", "said"), WRONG_OPTIONS, ids=[said[:40] for _, said in WRONG_OPTIONS])
def test_wrong_options_are_one_clear_line_and_leave_the_episode_untouched(options, said):
    env, other = make(), make()
    for one in (env, other):
        one.reset(seed=0)
        one.step(np.array([1.0, -0.5]))
    with pytest.raises(CrawlerError) as error:
        env.reset(options=options)
    assert said in str(error.value)
    assert "\n" not in str(error.value)
    follow = np.array([0.3, 0.9])
    assert np.array_equal(env.step(follow)[0], other.step(follow)[0])


def test_no_step_before_a_reset():
    with pytest.raises(CrawlerError, match="no episode has begun; call reset first"):
        make().step(np.zeros(2))


@pytest.mark.parametrize("kind", EACH_KIND)
def test_copies_go_on_by_themselves(kind):
    env = of_kind(kind, randomise={"noise": 0.01, "delay": 1}, steps=20)
    play(env, 5, seed=1)
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]

    def go_on(one):
        action = np.full(one.action_space.shape, 0.5)
        stepped = [one.step(action if k < 4 else -action) for k in range(8)]
        return [x for observation, reward, *_ in stepped for x in (*observation, reward)], play(one, 3)[0].tolist()

    expected = go_on(env)
    assert all(go_on(one) == expected for one in copies)


def test_copies_of_an_environment_that_was_drawn():
    pytest.importorskip("matplotlib")
    env = make(render_mode="rgb_array")
    play(env, 2, seed=1)
    assert np.array_equal(env.render(), copy.deepcopy(env).render())


@pytest.mark.parametrize("name", ["crawler_lab/Crawler-v0", "Crawler-v0"])
def test_it_is_registered_by_its_namespace_and_by_its_earlier_name(name):
    assert isinstance(gymnasium.make(name).unwrapped, crawler_lab.gym.CrawlerEnv)
