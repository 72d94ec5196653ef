"""What `crawler replay` finds in the recordings of real runs: a simulator in lock-step under a gait player."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")

from crawler_model import load_scene, simulate
from crawler_ros.replay import analyse

from ...commands import crawler
from ...processes import wait_until
from ...recordings import record
from .graph import graph

PERIODS = 4


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    """Runs of a simulator in lock-step under a gait player, made on demand."""
    made: dict[str, Path] = {}

    def run(scene: str) -> Path:
        if scene not in made:
            folder = tmp_path_factory.mktemp(scene)
            with graph(folder) as ros:
                given = f"scene:={scene}"
                simulator = ros.start(
                    "crawler_ros.node.simulator", given, f"record:={folder / 'bags'}", "lock_step:=true"
                )
                wait_until(lambda: "waiting for commands" in simulator.said, what="the start")
                player = ros.start("crawler_ros.node.gait_player", given, f"periods:={PERIODS}", "patience:=0.0")
                assert player.wait() == 0, player.said
                assert simulator.end() == 0
            (made[scene],) = (folder / "bags").iterdir()
        return made[scene]

    return run


CLOSED_FORMS = {"two_anchor_a": 2.0, "two_anchor_b": 2.0, "two_anchor_c": 2.0, "three_contacts_two_ways": 0.07}


@pytest.mark.parametrize(
    "name",
    ["two_anchor_a", "two_anchor_b", pytest.param("three_contacts_two_ways", marks=pytest.mark.slow), "hybrid_body"],
)
def test_a_real_run_gains_in_each_cycle_what_the_model_says(real, name):
    found = analyse(real(name))
    assert found.problems == ()
    assert found.comparison.identical
    assert found.comparison.ticks > 100
    assert found.cycle_source == "drive"
    offline = simulate(load_scene(name), duration=PERIODS * load_scene(name).drive.period)
    assert [c.translation for c in found.cycles] == pytest.approx(offline.per_period.tolist(), abs=1e-12)
    if name in CLOSED_FORMS:
        assert found.cycles[-1].translation == pytest.approx(CLOSED_FORMS[name], abs=1e-12)
    for cycle in found.cycles:
        assert cycle.energy.residual < 1e-12
        assert cycle.energy.stored + cycle.energy.dissipation == pytest.approx(cycle.energy.work)
    assert found.energy.dissipation == pytest.approx(offline.energy.dissipation)


def test_json_has_the_keys_of_the_contract_and_only_numbers(real):
    done = crawler("replay", real("two_anchor_a"), "--json")
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 1

    def refuse(text):
        raise AssertionError(text)

    said = json.loads(done.stdout, parse_constant=refuse)
    assert {"health", "complete", "cycles", "slips", "energy", "margins", "resimulation"} <= said.keys()
    assert said["complete"] is True
    assert said["resimulation"]["identical"] is True
    assert said["resimulation"]["max_difference"] == 0.0
    assert said["resimulation"]["first_difference"] is None
    assert said["resimulation"]["ticks"] == said["health"]["/joint_states"]["count"]
    cycle = {"start", "end", "translation", "slip_forward", "slip_backward", "work", "dissipation", "stored"}
    assert cycle | {"residual", "least_margin", "transient"} <= said["cycles"][0].keys()
    assert {"contact", "direction", "start", "length", "distance"} <= said["slips"][0].keys()
    assert {"internal_dissipation", "work", "loads_work", "dissipation", "jump_loss", "stored", "residual"} == said[
        "energy"
    ].keys()
    assert {"least", "least_at", "visited", "unique"} <= said["margins"].keys()


def test_text_fits_a_screen(real):
    done = crawler("replay", real("two_anchor_b"))
    assert done.returncode == 0
    assert len(done.stdout.splitlines()) <= 40
    assert "identical to the bit" in done.stdout
    assert "4 cycle(s), the drive's periods; 0 transient" in done.stdout
    assert "net" not in done.stderr


def test_the_real_and_the_made_up_recording_say_the_same(real, tmp_path):
    ours = analyse(record(tmp_path / "made", "two_anchor_a", PERIODS)).as_plain()
    theirs = analyse(real("two_anchor_a")).as_plain()
    assert ours["cycles"] == theirs["cycles"]
    assert ours["slips"] == theirs["slips"]


def test_a_plane_body(real):
    found = analyse(real("planar_three_points"))
    assert found.problems == ()
    assert found.comparison.identical
    assert len(found.cycles[0].translation) == 2
    assert all(s["distance"] >= 0.0 and -np.pi <= s["direction"] <= np.pi for s in found.as_plain()["slips"])
    json.dumps(found.as_plain(), allow_nan=False)
