"""How fast records were, and what masses would have changed of them: `speeds` and `inertia` of an identification."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from crawler_lab import Identification, identify, predict
from crawler_lab.identify.sensor.sensor import PERFECT
from crawler_model import Scene, simulate

from .synthetic import chain, measure

TIMES = np.arange(5.0)
ROWS = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.15], [0.0, 0.1], [0.0, 0.0]])


def fit(body: dict[str, object], *paces: float) -> Identification:
    """Fit records of the same way, each at another pace."""
    document = chain(3)
    document["body"] |= body
    records = [measure(document, (TIMES / pace).tolist(), ROWS) for pace in paces]
    return identify(
        Scene.model_validate(document), records, ["friction.forward"], sensor=PERFECT, seconds=0.0, hold_out=0.0
    )


def test_the_fastest_of_all_records_counts():
    found = fit({"masses": 0.05}, 1.0, 4.0, 2.0)
    # link 1 changes by 0.15 m and link 0 by 0.1 m in a quarter of a second
    assert found.speeds == pytest.approx({"link_0": 0.4, "link_1": 0.6})
    numbers = [simulate(found.playback(i)).inertia.number for i in range(3)]
    assert numbers[1] == pytest.approx(4.0 * numbers[0], rel=1e-6)  # in proportion to the pace
    assert found.inertia.number == max(numbers) == numbers[1]
    plain = found.summary()
    assert plain["speeds"] == found.speeds
    assert plain["inertia"] == found.inertia.summary()


def test_a_prediction_notes_a_drive_that_is_faster_than_all_records():
    found = fit({}, 1.0, 2.0)
    assert found.inertia is None
    assert found.summary()["inertia"] is None
    drive = {"times": TIMES.tolist(), "actuation": ROWS.tolist(), "period": 4.0}
    for pace, times in ((2.0, None), (3.0, 1.5)):
        faster = drive | {"times": (TIMES / pace).tolist(), "period": 4.0 / pace}
        told = predict(found.scene, found.summary(), Scene.model_validate(chain(3) | {"drive": faster}))
        assert (told.faster and told.faster.speed / told.faster.recorded) == (times and pytest.approx(times))
        assert sum("faster than the record" in note and "1.5 times" in note for note in told.notes) == bool(times)
        assert told.summary()["faster"] == (told.faster and dataclasses.asdict(told.faster))
