"""The first lines of a method's page name the kinds of scenes that it takes; all others end in one line."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("cma")
pytest.importorskip("gymnasium")

import gymnasium

import crawler_lab.gym  # noqa: F401
from crawler_lab import Measurements, excite, identify, optimise, predict, sensitivities
from crawler_lab.identify.measurements import channel_names
from crawler_lab.identify.sensor.sensor import PERFECT
from crawler_model import CrawlerError, Scene, largest_tow, limit_cycle, load_scene, simulate, steepest_climb

from ..pages import ROOT


def weighty(name: str) -> Scene:
    """A scene of the gallery with a body that a slope loads."""
    document = load_scene(name).document()
    return Scene.model_validate(document | {"body": document["body"] | {"weights": 0.5}})


KINDS = {
    "on a line": load_scene("slope_climber"),
    "on patches": load_scene("hill_top"),
    "on a profile": weighty("leaving_ice"),
    "between walls": weighty("wall_pusher"),
    "in the plane": load_scene("planar_rectilinear"),
    "bodies that turn": load_scene("scissors"),
}
FIRST_LINES = 8


def stiffness_of(scene: Scene) -> str:
    return "body.links.stiffness" if scene.body.turning is None else "body.joints.stiffness"


def find_gait(scene: Scene) -> None:
    axis = "[0]" if scene.dimension == 2 and scene.body.turning is None else ""
    column = 0 if scene.body.turning is None else 2
    optimise(scene, free={f"drive.actuation[1][{column}]{axis}": (0.05, 0.1)}, seconds=0.05)


def find_stiffness(scene: Scene) -> None:
    run = simulate(scene, 1.0, 20.0)
    names = scene.columns.names[: scene.columns.lengths]
    rows = scene.drive.sample(np.rint(run.time * 1e9).astype(np.int64))[:, : len(names)]
    position = (scene.body.position + run.displacement).reshape(run.time.size, -1)
    channels = [name for name in channel_names(scene) if name.startswith("contact_")]
    measured = Measurements("camera", run.time, tuple(channels), position, names, rows, run.time)
    identify(scene, [measured], [stiffness_of(scene)], sensor=PERFECT, offset="none", seconds=0.0)


def forecast(scene: Scene) -> None:
    entry = {"names": [stiffness_of(scene)], "values": [20.0], "covariance": [[0.01]], "freedom": 100.0}
    known = {"schema": 1, "posterior": entry}
    predict(scene, known, periods=1)


def learn(scene: Scene) -> None:
    more = {"direction": 0.0} if scene.dimension == 2 else {}
    task = {"task": "translation"} | more if scene.body.turning is None else {"task": "steer"}
    env = gymnasium.make("crawler_lab/Crawler-v0", scene=scene, **task)
    env.reset(seed=1)
    env.step(env.action_space.sample())


METHODS: dict[str, tuple[str, Callable[[Scene], object]]] = {
    "crawler optimise": ("optimise", find_gait),
    "crawler identify": ("identify", find_stiffness),
    "crawler excite": ("identify", lambda scene: excite(scene, [stiffness_of(scene)], (-0.1, 0.1), interval=1.0)),
    "crawler predict": ("predict", forecast),
    "sensitivities": ("sensitivities", lambda scene: sensitivities(scene, [stiffness_of(scene)], 1.0, 4.0)),
    "limit_cycle": ("sensitivities", limit_cycle),
    "largest_tow": ("loads", largest_tow),
    "steepest_climb": ("loads", steepest_climb),
    "crawler_lab/Crawler-v0": ("learn", learn),
}


def stated(page: str, method: str) -> set[str]:
    """Read the kinds of scenes from the first lines of a page."""
    head = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8").splitlines()[:FIRST_LINES]
    for line in head:
        found = re.match(r"(?:- )?Scenes of ([^:]*): ([^.]*)\.", line)
        if found and f"`{method}`" in found[1]:
            return set(found[2].split(", "))
    raise AssertionError(f"docs/{page}.md does not begin with the scenes of {method}")


@pytest.mark.parametrize("method", METHODS)
def test_bodies_with_hysteresis_and_backlash_are_bodies_on_a_line(method: str) -> None:
    document = load_scene("rubber_worm").document()
    body = document["body"]
    loose = body | {"links": body["links"] | {"backlash": 0.01}, "weights": 1.0}
    METHODS[method][1](Scene.model_validate(document | {"body": loose}))


@pytest.mark.parametrize("method", METHODS)
def test_bodies_whose_friction_changes_with_elongations_are_bodies_on_a_line(method: str) -> None:
    scene = weighty("three_contacts_two_ways").document()
    entries = [{"link": j, "contacts": [j, j + 1], "elongation": [-0.2, 0.1], "added": [0.1, 0.0]} for j in (0, 1)]
    friction = scene["friction"] | {"with_elongation": entries}
    METHODS[method][1](Scene.model_validate(scene | {"friction": friction}))


@pytest.mark.parametrize("method", METHODS)
def test_the_page_of_a_method_states_its_scenes(method: str) -> None:
    page, run = METHODS[method]
    for kind, scene in KINDS.items():
        if kind in stated(page, method):
            run(scene)
            continue
        with pytest.raises(CrawlerError) as refused:
            run(scene)
        assert "\n" not in str(refused.value)
