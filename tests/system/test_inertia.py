"""The inertia number on the command line and of a node, and the announced deviation compared with bodies with
masses."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks.inertia import build_bodies, step_in_mujoco, step_with_masses, with_masses
from crawler_model import simulate

from ..commands import crawler

SCENE = """
name: two
body: {contacts: [0.0, 0.2], weights: 0.5, links: {stiffness: 20.0}}
friction: {forward: 0.1, backward: 0.3}
drive: {times: [0, 5, 10], period: 10, actuation: [[0], [0.1], [0]]}
"""


def good(*words: object) -> str:
    done = crawler(*words)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_simulate_and_check_report_the_number(tmp_path):
    scene = tmp_path / "two.yaml"
    scene.write_text(SCENE)
    found = json.loads(good("simulate", str(scene), "--json"))["inertia"]
    assert found["number"] == pytest.approx(0.0505, abs=1e-4)
    assert found["deviation"] == pytest.approx([found["number"] / 10, found["number"] / 4])
    assert found["period_for_1_percent"] == pytest.approx(12.62, abs=0.01)
    checked = json.loads(good("check", str(scene), "--json"))["inertia"]
    assert (checked["contact"], checked["number"]) == (1, pytest.approx(found["number"]))
    assert "inertia number 0.0505 (contact 1 at 0.25 s)" in good("simulate", str(scene))
    heavy = json.loads(good("check", str(scene), "--mass", "0.2", "--json"))
    assert heavy["inertia"]["number"] == pytest.approx(0.1, rel=1e-9)
    assert any("inertia number 0.1 " in line for line in heavy["findings"])
    assert json.loads(good("check", "three_contacts_one_way", "--json"))["inertia"] is None


@pytest.mark.parametrize("damping", [0.05, 0.5])
def test_mujoco_deviates_as_the_judge_does(damping):
    """Friction forward and backward differs, which MuJoCo has as a mean and a force."""
    pytest.importorskip("mujoco")
    scene = build_bodies(1)[0]
    run = simulate(scene)
    heavy = with_masses(scene, (0.3 / run.inertia.number) ** 2)
    ours, theirs = (
        step(heavy, heavy.ground.masses, damping, 3)[1:].mean() for step in (step_with_masses, step_in_mujoco)
    )
    gain = run.per_period[-1]
    assert abs(ours / gain - 1.0) > 0.01
    assert theirs / gain == pytest.approx(ours / gain, abs=2e-3)


@pytest.mark.parametrize("body", range(3))
def test_masses_deviate_by_no_more_than_is_announced(body):
    scene = build_bodies(3)[body]
    run = simulate(scene)
    for number in (0.05, 0.1):
        heavy = with_masses(scene, (number / run.inertia.number) ** 2)
        announced = simulate(heavy).inertia
        assert announced.number == pytest.approx(number, rel=1e-6)
        gains = step_with_masses(heavy, heavy.ground.masses, 0.05)
        deviation = np.abs(gains[3:].mean() / run.per_period[-1] - 1.0)
        assert 0.0 < deviation < announced.bound
