"""Segments that touch, and isolated contacts at their ends: parts of a body that share contacts."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from crawler_lab.sweep.many_runs import simulate_many
from crawler_lab.sweep.vary import vary
from crawler_model import Crawler, Scene, SceneError, simulate
from crawler_model.body.names import name_every_contact, name_every_spring
from crawler_ros.node.robot_description import describe_robot
from crawler_ros.wire.states import StationReader, contact_names, shown_contacts, station_names
from tests.commands import crawler

STRAINS = [[0.0, 0.0, 0.0], [0.4, 0.0, -0.1], [0.3, 0.5, 0.0], [-0.2, 0.1, 0.6], [0.0, 0.0, 0.0]]
ENDS, STIFFNESS, ELEMENTS = [(0.0, 0.3), (0.3, 0.5), (0.5, 0.9)], [2.0, 1.0, 3.0], [6, 5, 4]
COUNTS = dict(zip(("tail", "middle", "head"), ELEMENTS, strict=True))
FORWARD, BACKWARD = [0.1, 0.3, 0.2], [0.4, 0.5, 0.3]


def worm(*, feet: bool = True, **more: Any) -> dict[str, Any]:
    """Return three chambers that touch, with feet at an outer and at an inner end unless these are left out."""
    segments = [
        {"name": name, "from": ends[0], "to": ends[1], "stiffness": k, "elements": n}
        | {"friction": {"forward": forward, "backward": backward}}
        for name, ends, k, n, forward, backward in zip(
            ("tail", "middle", "head"), ENDS, STIFFNESS, ELEMENTS, FORWARD, BACKWARD, strict=True
        )
    ]
    drive = {"times": [0, 1, 2, 3, 4], "period": 4, "actuation": STRAINS}
    data: dict[str, Any] = {"name": "worm", "body": {"segments": segments}, "drive": drive}
    if feet:
        data["body"]["contacts"] = [0.3, 0.9]
        data["friction"] = {"forward": [0.01, 0.02], "backward": [0.05, 0.03]}
    return data | more


def written_out() -> Scene:
    """Build the same body from isolated contacts and links alone."""
    position, forward, backward, stiffness, lengths = [0.0], [0.0], [0.0], [], []
    for (begin, end), k, n, plus, minus in zip(ENDS, STIFFNESS, ELEMENTS, FORWARD, BACKWARD, strict=True):
        h = (end - begin) / n
        for side, mu in ((forward, plus), (backward, minus)):
            side[-1] += 0.5 * mu * h
            side += [mu * h] * (n - 1) + [0.5 * mu * h]
        position += np.linspace(begin, end, n + 1)[1:].tolist()
        stiffness += [k / h] * n
        lengths += [h] * n
    for i, plus, minus in ((6, 0.01, 0.05), (15, 0.02, 0.03)):
        forward[i] += plus
        backward[i] += minus
    rows = np.repeat(np.array(STRAINS), ELEMENTS, axis=1) * lengths
    return Scene.model_validate(
        {
            "name": "written out",
            "body": {"contacts": position, "links": {"stiffness": stiffness}},
            "friction": {"forward": forward, "backward": backward},
            "drive": {"times": [0, 1, 2, 3, 4], "period": 4, "actuation": rows.tolist()},
        }
    )


@pytest.mark.parametrize("method", ["exact", "catch_up"])
def test_chambers_move_as_the_contacts_and_links_that_they_consist_of(method):
    chambers, plain = (simulate(s, duration=12.0, method=method) for s in (Scene.model_validate(worm()), written_out()))
    assert chambers.displacement == pytest.approx(plain.displacement, abs=1e-13)
    assert np.ptp(plain.net_translation) > 0.05
    assert chambers.energies.dissipation[-1] == pytest.approx(plain.energies.dissipation[-1], rel=1e-12)


def test_each_part_keeps_its_name_and_a_contact_that_parts_share_has_that_of_the_first():
    body = Scene.model_validate(worm()).body
    contacts = [f"tail/contact_{j}" for j in range(6)] + ["contact_0"] + [f"middle/contact_{j}" for j in range(1, 6)]
    assert name_every_contact(body) == (*contacts, *(f"head/contact_{j}" for j in range(1, 4)), "contact_1")
    springs = [f"{name}/element_{j}" for name, n in COUNTS.items() for j in range(n)]
    assert name_every_spring(body) == tuple(springs)
    assert sorted(contact_names(body)) == sorted(name_every_contact(body))
    assert [name_every_contact(body)[i] for i in shown_contacts(body)] == contact_names(body)
    assert station_names(body)[2:4] == ["tail.from", "tail.to"]
    assert body.share.sum() == pytest.approx(1.0)
    assert body.name_of(11) == "segment middle at 0.5 m"


def test_stations_at_one_contact_move_together():
    body = Scene.model_validate(worm()).body
    crawler_ = Crawler(Scene.model_validate(worm()))
    crawler_.advance([0.4, 0.0, -0.1])
    x = crawler_.displacement[body.stations]
    joints = np.concatenate((x[:1], crawler_.joint_elongation))
    assert StationReader(body).read(joints) == pytest.approx(x, abs=1e-15)
    text = describe_robot(Scene.model_validate(worm()))
    assert text.count('type="fixed"') == 4  # both sides of the foot at 0.3 m, the end of the middle, the foot at 0.9 m


@pytest.mark.parametrize("feet", [False, True])
def test_the_command_in_force_is_read_back(feet):
    crawler_ = Crawler(Scene.model_validate(worm(feet=feet)))
    friction = np.array([0.02, 0.01, 0.3, 0.1, 0.2])[0 if feet else 2 :]
    crawler_.advance([0.1, 0.2, 0.3], friction, 2.0 * friction)
    row = crawler_.row
    crawler_.follow(crawler_.target([0.1, 0.2, 0.3], friction, 2.0 * friction)[None])
    assert crawler_.row == pytest.approx(row, abs=1e-15)
    assert crawler_.row == pytest.approx([0.1, 0.2, 0.3, *friction, *(2.0 * friction)], abs=1e-15)


def test_a_row_that_contacts_leave_open_is_one_with_the_same_target():
    data = worm(feet=False)
    for segment in data["body"]["segments"]:
        segment["friction"]["forward"] = {"at": [0.0, 0.9], "value": [0.1, 0.2]}
    columns = Scene.model_validate(data).columns
    given = np.linspace(0.1, 0.7, columns.count)
    assert columns.spread(columns.gather(columns.spread(given))) == pytest.approx(columns.spread(given), abs=1e-15)
    assert columns.gather(columns.spread(given)) != pytest.approx(given)


def test_equal_chambers_get_equal_elements():
    data = worm(feet=False)
    for place, segment in enumerate(data["body"]["segments"]):
        segment |= {"from": place * 0.25, "to": (place + 1) * 0.25, "stiffness": 1.0, "accuracy": 0.02}
        segment["friction"] = {"forward": 0.1, "backward": 0.4}
        del segment["elements"]
    counts = [segment.elements for segment in Scene.model_validate(data).body.segments]
    assert counts[0] == counts[1] == counts[2] > 2


def test_links_join_only_parts_that_do_not_touch():
    data = worm(feet=False)
    data["body"] |= {"contacts": [0.9, 1.2], "links": [{"stiffness": 4.0}]}
    data |= {"friction": {"isotropic": 0.1}, "drive": None}
    body = Scene.model_validate(data).body
    assert body.ends[body.link_springs].tolist() == [[15, 16]]
    assert body.is_chain
    del data["body"]["links"]
    with pytest.raises(SceneError, match=r"body.links: missing; .* segments that do not touch as"):
        Scene.model_validate(data)


def test_weights_and_loads_of_parts_that_touch_add_up():
    data = worm(loads=[0.01, 0.0, 0.02, 0.0, 0.0], ground={"slope": 2.0})
    data["body"]["weights"] = [0.1, 0.0, 1.0, 2.0, 0.0]
    scene = Scene.model_validate(data)
    assert scene.ground.weight[6] == pytest.approx(0.1 + 0.025 + 0.04)
    own = scene.drive.loads[0] + scene.ground.weight * np.sin(np.radians(2.0))
    assert own[6] == pytest.approx(0.01 + 0.025 * 0.02)
    assert scene.ground.weight.sum() == pytest.approx(0.1 + 0.3 + 0.4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"start": {"displacement": [0.0, 0, 0, 1e-4, 0, 0, 0, 0]}},
            "entry 3 is 0.0001 m, but another one for the same contact, contact 0, is 0 m",
        ),
        (
            {"friction": {"coefficient": {"isotropic": 0.1}}},
            "friction: of the parts that touch at 0.3 m some have coefficients and some have forces",
        ),
    ],
)
def test_parts_that_touch_agree_where_they_do(change, message):
    data = worm(**change)
    data["body"]["weights"] = 1.0
    with pytest.raises(SceneError, match=message):
        Scene.model_validate(data)


def test_a_sweep_over_chambers_repeats_single_runs():
    scene = Scene.model_validate(worm())
    found = simulate_many(vary(scene, {"body.segments.middle.stiffness": [0.5, 1.5]}), duration=8.0)
    for value, gain in zip((0.5, 1.5), found.per_period, strict=True):
        data = worm()
        data["body"]["segments"][1]["stiffness"] = value
        assert gain == pytest.approx(simulate(Scene.model_validate(data), duration=8.0).per_period[-1], abs=1e-13)


def test_the_command_checks_and_simulates_chambers(tmp_path):
    path = tmp_path / "worm.yaml"
    path.write_text(json.dumps(worm()))
    checked = crawler("check", str(path))
    assert "segment middle (5 elements), segment head (4 elements), 0 links; valid" in checked.stdout.replace("\n", " ")
    found = json.loads(crawler("simulate", str(path), "--json").stdout)
    assert len(found["displacement"][0]) == 8
    assert found["displacement"][-1][3] == found["displacement"][-1][0]
    assert found["unique"]
    assert found["energy"]["residual"] < 1e-12
