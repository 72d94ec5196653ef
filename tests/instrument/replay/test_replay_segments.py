"""What a replay says of segments does not depend on how finely they are cut."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model import Scene
from crawler_ros.replay import Replay, analyse
from crawler_ros.replay.parts import parts_by_name, parts_of
from crawler_ros.replay.show.compare import compare_recordings

from ...commands import crawler
from ...recordings import record, rewrite

parquet = pytest.importorskip("pyarrow.parquet")

MESHES = (8, 16, 32, 64, 128)
RATE = 40.0


def body(kind: str, elements: int, **more) -> Scene:
    """A segment, or a segment with a contact before it; its strain goes up and down once a second."""
    trunk = {"name": "trunk", "from": 0.0, "to": 1.0, "stiffness": 2.0, "elements": elements, **more}
    trunk["friction"] = {"forward": 0.4, "backward": 1.1}
    document = {"name": kind, "body": {"segments": [trunk]}}
    times = np.linspace(0.0, 1.0, int(RATE) + 1)
    strain = 0.25 - 0.25 * np.cos(2.0 * np.pi * times)
    rows = strain[:, None]
    if kind == "hybrid":
        document["body"] |= {"contacts": [1.5], "links": {"stiffness": 4.0, "between": [["trunk.to", 0]]}}
        document["friction"] = {"forward": 0.1, "backward": 0.2}
        rows = np.column_stack((0.3 * np.sin(2.0 * np.pi * times).round(12), strain))
    document["drive"] = {"times": times.tolist(), "period": 1.0, "actuation": rows.tolist()}
    return Scene.model_validate(document)


@pytest.fixture(scope="module", params=["segment", "hybrid"])
def refined(request, tmp_path_factory) -> list[Replay]:
    """Three periods of one body, on finer and finer meshes."""
    folder = tmp_path_factory.mktemp(request.param)
    paths = [record(folder / f"n{n}", body(request.param, n), 3, rate=RATE) for n in MESHES]
    return [analyse(path) for path in paths]


def test_slips_are_those_of_contacts_and_ends_of_segments(refined):
    for found in refined:
        assert found.comparison.identical
        assert found.stations[-2:] == ("trunk.from", "trunk.to")
        assert {s["contact"] for s in found.as_plain()["slips"]} == set(found.stations)
        assert len(found.contacts) > len(found.stations)


def test_the_sums_of_slips_converge_as_the_mesh_is_refined(refined):
    for name in ("slip_forward", "slip_backward"):
        last = np.array([getattr(found.cycles[-1], name) for found in refined])
        steps = np.abs(np.diff(last))
        assert last[-1] > 0.01
        assert steps[-1] < 0.01 * last[-1]
        assert steps[-1] <= 0.5 * steps[0]
        assert last.max() < 1.5 * last.min()  # a sum over elements would grow sixteenfold


def test_the_slips_themselves_converge(refined):
    fine, finer = (
        sorted(found.as_plain()["slips"], key=lambda s: (s["contact"], s["start"])) for found in refined[-2:]
    )
    assert [(s["contact"], s["direction"]) for s in fine] == [(s["contact"], s["direction"]) for s in finer]
    for one, two in zip(fine, finer, strict=True):
        assert one["start"] == pytest.approx(two["start"], abs=2.0 / RATE)
        assert one["length"] == pytest.approx(two["length"], abs=3.0 / RATE)
        assert one["distance"] == pytest.approx(two["distance"], rel=0.02, abs=1e-3)


def test_slips_forward_less_slips_back_are_the_translation(refined):
    for found in refined:
        for cycle in found.cycles:
            difference = (cycle.slip_forward - cycle.slip_backward) / (len(found.stations) - 1)
            assert difference == pytest.approx(cycle.translation, abs=1e-13)


def test_runs_on_two_meshes_can_be_compared(refined):
    found = compare_recordings(refined[-1].path, refined[-2].path)
    assert found.commands_differ is None
    assert found.max_difference < 0.01
    for row in found.slips:
        assert row["count"] == 0
        assert abs(row["distance"]) < 0.02


def test_without_its_scene_it_is_the_same_but_for_the_weights_of_the_ends(refined, tmp_path):
    """What the contacts' names and places tell."""
    found = refined[-1]
    alone = analyse(rewrite(found.path, tmp_path / "alone", lambda *message: [message], None))
    assert alone.scene is None
    assert set(alone.stations) == set(found.stations)
    ours, theirs = (f.slips.distance.sum() for f in (alone, found))
    assert ours == pytest.approx(theirs, rel=0.05)


def test_contacts_that_are_not_shown_count_all_the_same(tmp_path):
    every, few = (
        analyse(record(tmp_path / f"s{n}", body("segment", 64, **more), 2, rate=RATE))
        for n, more in ((0, {}), (5, {"shown": 5}))
    )
    assert len(few.contacts) == 5
    assert few.cycles[-1].slip_forward == every.cycles[-1].slip_forward
    assert few.slips.distance.tolist() == every.slips.distance.tolist()


def test_tables_and_text_speak_of_the_segment(refined, tmp_path):
    path = refined[0].path
    done = crawler("replay", path, "--parquet", tmp_path / "t", "--png", tmp_path / "x.png")
    assert done.returncode == 0, done.stderr
    assert "trunk.to: " in done.stdout
    slips = parquet.read_table(tmp_path / "t" / "slips.parquet")
    assert set(slips["contact"].to_pylist()) == set(refined[0].stations)


def test_parts_are_those_of_the_body():
    mesh = body("hybrid", 10).body
    parts = parts_of(mesh)
    assert parts.station_names == ("contact_0", "trunk.from", "trunk.to")
    assert mesh.position[parts.stations].tolist() == [1.5, 0.0, 1.0]
    x = np.random.default_rng(0).normal(size=(3, mesh.contacts))
    np.testing.assert_allclose(parts.average(x).mean(axis=1), x @ mesh.share, atol=1e-15)
    forward, backward = parts.slid(x)
    np.testing.assert_allclose((forward - backward) / 2, x @ mesh.share, atol=1e-15)
    names = ("contact_0", "trunk/contact_0", "trunk/contact_5", "trunk/contact_10")
    guessed = parts_by_name(names, np.array([1.5, 0.0, 0.5, 1.0]))
    assert guessed.station_names == parts.station_names
    assert guessed.stations.tolist() == [0, 1, 3]
    assert guessed.share.tolist() == [1.0, 0.25, 0.5, 0.25]
