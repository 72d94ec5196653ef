"""An examination that Ctrl-C ends keeps the best gait; what is passive, or stays as it is, needs no stroke."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

pytest.importorskip("cma")

from crawler_lab import excite, optimise, pareto
from crawler_lab.optimise import examine
from crawler_lab.optimise.request import find_driven, find_strokes
from crawler_model import Scene, SceneError
from crawler_model.body.names import name_joints

CHAIN = {
    "name": "chain",
    "body": {"contacts": [0, 1, 2, 3], "links": {"stiffness": 1.0}},
    "friction": {"forward": 0.1, "backward": 0.3},
}


def test_ctrl_c_in_the_examination_keeps_the_best_gait(monkeypatch: pytest.MonkeyPatch) -> None:
    look, looked = examine._find_transient, []

    def once(*given: Any) -> float:
        looked.append(given)
        if len(looked) == 1:
            raise KeyboardInterrupt
        return look(*given)

    monkeypatch.setattr(examine, "_find_transient", once)
    found = optimise(Scene.model_validate(CHAIN), waypoints=2, stroke=(0.0, 1.0))
    assert found.interrupted
    assert found.value > 0.0


SEGMENT = {"name": "tail", "from": 1.5, "to": 2.5, "friction": CHAIN["friction"], "elements": 4}
LINKS: list[dict[str, Any]] = [{"stiffness": 1.0, "between": [0, 1]}, {"stiffness": 2.0, "between": [1, "tail.from"]}]
SEGMENTED = {"contacts": [0, 1], "links": LINKS, "segments": [SEGMENT | {"stiffness": 1.0}]}
SLACK = [{"stiffness": 1.0}, {"passive": {"stiffness": 2.0}}]
BODIES = {
    "a passive link": {"contacts": [0, 1, 2], "links": SLACK},
    "a passive link before others": {"contacts": [0, 1, 2], "links": SLACK[::-1]},
    "a passive segment": {
        "contacts": [0, 1],
        "links": [LINKS[0], {"passive": {"stiffness": 2.0}, "between": [1, "tail.from"]}],
        "segments": [SEGMENT | {"passive": {"stiffness": 1.0}}],
    },
    "a link and a segment that stay": SEGMENTED,
}


def held_scene(body: str, moved: str, with_drive: bool) -> Scene:
    """A body of which a drive moves a single link, while the others have the length 0.01 m."""
    document = CHAIN | {"body": BODIES[body]}
    count, place = len(Scene.model_validate(document).columns.actuation_sizes), int(moved[-1])
    rows = np.full((2, count), 0.01)
    rows[:, place] = 0.0, 1.0
    drive = {"times": [0, 1], "period": 2.0, "actuation": rows.tolist()}
    return Scene.model_validate(document | ({"drive": drive, "start": "relaxed"} if with_drive else {}))


@pytest.mark.parametrize("stroke", ["by name", "of the drive"])
@pytest.mark.parametrize("body", BODIES)
def test_what_has_no_stroke_stays_as_the_scene_has_it(body: str, stroke: str) -> None:
    moved = "link_1" if body == "a passive link before others" else "link_0"
    by_name = stroke == "by name"
    scene, strokes = held_scene(body, moved, not by_name), {moved: (0.0, 1.0)} if by_name else None
    best = optimise(scene, waypoints=2, stroke=strokes, seconds=1.0)
    front = pareto(scene, waypoints=2, stroke=strokes, seconds=1.0)
    excited = excite(scene, ["friction.forward"], stroke=strokes, duration=1.0)
    assert best.names == tuple(f"drive.actuation[{i}][{moved[-1]}]" for i in range(2))
    assert best.value > 0.0
    assert front.names == best.names
    for found in (best.scene, front.points[0].scene, excited.scene):
        rows = np.array(found.document()["drive"]["actuation"])
        assert np.ptp(rows[:, int(moved[-1])]) > 0.0
        assert np.unique(np.delete(rows, int(moved[-1]), axis=1)).tolist() == [0.0 if by_name else 0.01]


@pytest.mark.parametrize("body", [name for name in BODIES if "passive" in name])
def test_one_stroke_for_all_is_that_of_what_is_driven(body: str) -> None:
    scene = Scene.model_validate(CHAIN | {"body": BODIES[body]})
    assert find_strokes(scene, (0.0, 1.0))[1] == [(0.0, 1.0)]


@pytest.mark.parametrize("body", [name for name in BODIES if "passive" in name])
def test_a_stroke_of_what_is_passive_is_one_line(body: str) -> None:
    scene = Scene.model_validate(CHAIN | {"body": BODIES[body]})
    for name in itertools.compress(name_joints(scene.body), ~find_driven(scene.body)):
        for verb in (optimise, pareto, lambda *given, **more: excite(*given, ["friction.forward"], **more)):
            with pytest.raises(SceneError, match=f"stroke: '{name}' of chain is passive, .* leave it out"):
                verb(scene, stroke={name: (0.0, 1.0)})


def test_a_body_that_is_passive_throughout_is_one_line() -> None:
    scene = Scene.model_validate(CHAIN | {"body": {"contacts": [0, 1], "links": {"passive": {"stiffness": 2.0}}}})
    with pytest.raises(SceneError, match="stroke: the links and segments of chain are all passive"):
        optimise(scene, stroke=(0.0, 1.0))
