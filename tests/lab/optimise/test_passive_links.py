"""An examination that Ctrl-C ends keeps the best gait; links that are passive need no stroke."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("cma")

from crawler_lab import optimise
from crawler_lab.optimise import examine
from crawler_model import Scene, SceneError

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


PASSIVE = CHAIN | {"body": {"contacts": [0, 1, 2], "links": [{"stiffness": 1.0}, {"passive": {"stiffness": 2.0}}]}}
DRIVE = {"times": [0, 1], "period": 2.0, "actuation": [[0.0, 0.0], [1.0, 0.0]]}


@pytest.mark.parametrize("stroke", [(0.0, 1.0), {"link_0": (0.0, 1.0)}, None], ids=["one", "by name", "of the drive"])
def test_a_passive_link_needs_no_stroke(stroke: Any) -> None:
    scene = Scene.model_validate(PASSIVE | ({"drive": DRIVE} if stroke is None else {}))
    found = optimise(scene, waypoints=2, stroke=stroke)
    assert found.names == ("drive.actuation[0][0]", "drive.actuation[1][0]")
    assert found.value > 0.0
    assert np.array(found.scene.document()["drive"]["actuation"])[:, 1].tolist() == [0.0] * 3


def test_a_stroke_of_a_passive_link_is_one_line() -> None:
    with pytest.raises(SceneError, match="stroke: 'link_1'"):
        optimise(Scene.model_validate(PASSIVE), stroke={"link_0": (0.0, 1.0), "link_1": (0.0, 1.0)})
