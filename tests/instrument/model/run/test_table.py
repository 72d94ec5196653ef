from __future__ import annotations

import itertools
import json
import sys

import numpy as np
import pytest

from crawler_model import Crawler, CrawlerError, Scene, TrajectoryColumns, load_scene, simulate
from crawler_model.body.drive import NS
from crawler_model.run import trajectory

from ..chains import scene

pa = pytest.importorskip("pyarrow")

LINE = (
    "two_anchor_a",
    "three_springs",
    "tow_puller",
    "slope_climber",
    "hybrid_body",
    "segment_climber",
    "ice",
    "hill_top",
)
PLANE = ("planar_three_points", "planar_rectilinear")
STEEP = {
    "name": "steep",
    "dimension": 2,
    "body": {
        "contacts": [[0, 0], [1, 0], [0, 1]],
        "links": {"between": [[0, 1], [1, 2], [2, 0]], "stiffness": [5, 4, 6]},
    },
    "friction": {"isotropic": [1.0, 1.2, 0.9]},
    "loads": [[0.1, 0.0], [0.0, 0.2], [0.0, 0.0]],
    "drive": {"times": [0, 0.5, 1], "actuation": [[[0, 0]] * 3, [[0.8, 0], [-0.3, 0.2], [0, 0]], [[0, 0]] * 3]},
}


def run_of(name: str, rate: float = 50.0):
    given = Scene.model_validate(STEEP) if name == "steep" else load_scene(name)
    return simulate(given, 2.0 * (given.drive.period or 1.0), rate / (given.drive.period or 1.0))


@pytest.fixture(scope="module", params=[*LINE, *PLANE, "steep"])
def run(request):
    return run_of(request.param)


def columns_of(table, names: list[str]) -> np.ndarray:
    return np.column_stack([table[name].to_numpy() for name in names])


def vectors_of(run, table, quantity: str) -> np.ndarray:
    """A quantity of all contacts, shape (T, N), in the plane (T, N, 2)."""
    contacts = [name.removesuffix("/state") for name in table.column_names if name.endswith("/state")]
    axes = ("_x", "_y") if run.displacement.ndim == 3 else ("",)
    return columns_of(table, [f"{c}/{quantity}{a}" for c in contacts for a in axes]).reshape(run.displacement.shape)


def follow(run):
    """The same run tick by tick: the crawler and the step of each tick."""
    crawler, drive = Crawler(run.scene, run.method), run.scene.drive
    ns = np.rint(run.time * NS).astype(np.int64)
    for before, after in itertools.pairwise(ns):
        targets = drive.ramps_between(int(before), np.array([after]))[1]
        yield crawler, crawler.follow(targets)


def test_names_and_units_of_a_chain():
    table = run_of("two_anchor_a").to_table()
    friction = [f"contact_{i}/{side}" for side in ("forward", "backward") for i in (0, 1)]
    each = [f"contact_{i}/{q}" for q in ("velocity", "state", "ground_force") for i in (0, 1)]
    commands = [f"command/{name}" for name in ("link_0", *friction)]
    energies = ["work", "dissipation", "loads_work", "jump_loss", "stored", "internal_dissipation"]
    expected = ["time", "contact_0", "contact_1", *commands, *each, *friction, "link_0/tension", "net_translation"]
    assert table.column_names == [*expected, *energies]
    units = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    assert units == TrajectoryColumns(load_scene("two_anchor_a")).units
    assert {units[name] for name in energies} == {"J"}
    assert [units[n] for n in ("time", "contact_0", "contact_0/velocity", "contact_0/state")] == ["s", "m", "m/s", "1"]
    about = json.loads(table.schema.metadata[b"crawler_trajectory"])
    assert about == {"schema": 1, "scene": "two_anchor_a", "method": "exact", "rate_hz": 50.0}


def test_names_and_units_of_other_bodies():
    hybrid = TrajectoryColumns(load_scene("hybrid_body")).units
    assert hybrid["trunk"] == hybrid["trunk/contact_3"] == hybrid["command/link_0"] == "m"
    assert hybrid["command/trunk"] == "1"
    assert hybrid["trunk/element_0/tension"] == hybrid["contact_0/forward"] == "N"
    wave = TrajectoryColumns(load_scene("friction_wave_segment")).units
    assert {unit for name, unit in wave.items() if name.startswith("command/") and "ward" in name} == {"N/m"}
    plane = TrajectoryColumns(load_scene("planar_three_points")).names
    assert plane[:5] == ("time", "contact_0/x", "contact_0/y", "contact_1/x", "contact_1/y")
    assert {"command/link_0/x", "contact_0/velocity_y", "link_1/tension_x", "net_translation_y"} <= set(plane)
    assert {"contact_0/load_x", "contact_2/load_y"} <= set(TrajectoryColumns(Scene.model_validate(STEEP)).names)


def test_every_column_is_named_once(run):
    table = run.to_table()
    assert len(set(table.column_names)) == table.num_columns
    assert tuple(table.column_names) == TrajectoryColumns(run.scene).names
    assert table.num_rows == run.time.size
    assert all(column.null_count == 0 and np.isfinite(column.to_numpy()).all() for column in table.columns)


def test_positions_commands_and_tensions_are_those_of_a_crawler(run):
    table, body = run.to_table(), run.scene.body
    planar = body.dimension == 2
    state = [name for name in table.column_names if name.endswith("/state")]
    axes = ("/x", "/y") if planar else ("",)
    position = columns_of(table, [name.removesuffix("/state") + axis for name in state for axis in axes])
    np.testing.assert_array_equal(position.reshape(run.position.shape), run.position)
    np.testing.assert_array_equal(run.position, body.position + run.displacement)
    np.testing.assert_array_equal(columns_of(table, state), run.contact_state)
    commands = [name for name in table.column_names if name.startswith("command/")]
    places = [run.scene.columns.names.index(name.removeprefix("command/")) for name in commands]
    tension = columns_of(table, [name for name in table.column_names if "/tension" in name])
    rows = columns_of(table, commands)
    near = 1e-12 * max(float(np.abs(tension).max()), 1.0)
    for i, (crawler, _) in enumerate(follow(run), 1):
        np.testing.assert_allclose(crawler.row[places], rows[i], atol=1e-12)
        np.testing.assert_allclose(crawler.displacement, run.displacement[i], atol=1e-12)
        if len(body.segments) == 0:  # else in another order
            np.testing.assert_allclose(crawler.tension.ravel(), tension[i], atol=near)


def test_energies_are_those_of_each_tick_and_balance(run):
    table = run.to_table()
    names = ("work", "dissipation", "loads_work", "jump_loss")
    work, dissipation, loads_work, jump_loss = (table[name].to_numpy() for name in names)
    stored = table["stored"].to_numpy()
    size = max(float(np.abs(work).max()), float(stored.max()))
    residual = np.diff(stored) + (dissipation + jump_loss - work - loads_work)[1:]
    exact = run.method == "exact"
    assert np.abs(residual).max() <= (1e-12 if exact else 1e-6) * size
    assert residual.sum() == pytest.approx(run.energy.residual, abs=1e-12 * size)
    steps = [[getattr(step, name) for name in names] for _, step in follow(run)]
    np.testing.assert_allclose(columns_of(table, list(names))[1:], steps, atol=1e-12 * size)
    for name, values in zip(names, (work, dissipation, loads_work, jump_loss), strict=True):
        assert values.sum() == pytest.approx(getattr(run.energy, name), abs=1e-12 * size)
        assert values[0] == 0.0
    assert stored[-1] - stored[0] == pytest.approx(run.energy.stored, abs=1e-12 * size)


def test_forces_are_in_equilibrium_and_within_friction(run):
    table = run.to_table()
    ground = vectors_of(run, table, "ground_force")
    loaded = any("/load" in name and not name.startswith("command/") for name in table.column_names)
    load = vectors_of(run, table, "load") if loaded else np.zeros(ground.shape)
    size = float(np.abs(ground).max())
    np.testing.assert_allclose((ground + load).sum(axis=1), 0.0, atol=1e-11 * size)
    if run.displacement.ndim == 3:
        if run.scene.directions.size == 0:
            friction = columns_of(table, [n for n in table.column_names if n.endswith("/friction")])
            assert (np.linalg.norm(ground, axis=2) <= friction + 1e-9 * size).all()
        return
    forward, backward = vectors_of(run, table, "forward"), vectors_of(run, table, "backward")
    assert (-forward - 1e-9 * size <= ground).all()
    assert (ground <= backward + 1e-9 * size).all()


def test_a_contact_that_slides_meets_its_friction():
    drive = {"times": [0, 1, 2], "actuation": [0, 5, 0], "period": 2}
    run = simulate(scene(2, forward=[1.0, 1.2], backward=[0.8, 1.5], drive=drive), 4.0, 20.0)
    table = run.to_table()
    state, both = run.contact_state[:-1], run.contact_state[:-1] == run.contact_state[1:]  # before and after
    forward, backward = vectors_of(run, table, "forward"), vectors_of(run, table, "backward")
    ground = vectors_of(run, table, "ground_force")
    ahead, back = (state == 1) & both, (state == -1) & both
    assert ahead.any()
    assert back.any()
    np.testing.assert_allclose(ground[:-1][ahead], -forward[:-1][ahead], atol=1e-12)
    np.testing.assert_allclose(ground[:-1][back], backward[:-1][back], atol=1e-12)


def test_velocities_integrate_to_displacements(run):
    velocity = vectors_of(run, run.to_table(), "velocity")
    assert not velocity[0].any()
    seconds = np.diff(run.time).reshape(-1, *(1,) * (velocity.ndim - 1))
    moved = run.displacement[0] + np.cumsum(velocity[1:] * seconds, axis=0)
    np.testing.assert_allclose(moved, run.displacement[1:], atol=1e-12)
    assert not velocity[run.contact_state == 0].any()


def test_friction_follows_the_ground_under_each_contact():
    run = simulate(load_scene("ice"))
    table, track = run.to_table(), run.scene.ground.track
    friction = columns_of(table, [f"contact_{i}/forward" for i in range(run.scene.body.contacts)])
    stretch = np.searchsorted(track.borders, run.position)
    expected = run.scene.drive.rows[0][run.scene.columns.lengths :][: friction.shape[1]]
    off = np.abs(run.position[..., None] - track.borders).min(axis=2) > 1e-9
    given = expected * np.take_along_axis(track.factor[0], stretch, axis=0)
    np.testing.assert_allclose(friction[off], given[off], rtol=1e-12)
    assert len(run.jumps) > 0
    assert np.unique(stretch[off]).size > 1


def test_the_energies_of_long_runs_and_of_catch_up_steps_balance():
    for method, near in (("exact", 1e-13), ("catch_up", 1.0)):
        run = simulate(load_scene("two_anchor_b"), 50.0, method=method)  # more ticks than are followed at a time
        e = run.energies
        residual = np.diff(e.stored) + (e.dissipation + e.jump_loss - e.work - e.loads_work)[1:]
        assert np.abs(residual).max() < near
        assert residual.sum() == pytest.approx(run.energy.residual, abs=1e-10)
        assert e.work.sum() == pytest.approx(run.energy.work, rel=1e-12)


def test_batches_are_the_table_whatever_their_size(run, monkeypatch):
    whole = run.to_table()
    monkeypatch.setattr(trajectory, "_NUMBERS", 1)
    monkeypatch.setattr(trajectory, "_FEWEST_ROWS", 7)
    batches = list(run.build_batches())
    assert [batch.num_rows for batch in batches[:-1]] == [7] * (len(batches) - 1)
    assert len(batches) == -(-run.time.size // 7)
    joined = pa.Table.from_batches(batches, run.build_schema())
    near = 1e-13 * max(float(np.abs(run.tension).max()), 1.0)
    for name in whole.column_names:
        np.testing.assert_allclose(joined[name].to_numpy(), whole[name].to_numpy(), atol=near, err_msg=name)


def test_a_run_without_ticks_is_one_row():
    table = simulate(load_scene("two_anchor_a"), 0.0).to_table()
    assert table.num_rows == 1
    assert table["contact_0/velocity"].to_pylist() == [0.0]


def test_data_frames_hold_the_same_numbers(run):
    pandas, polars = pytest.importorskip("pandas"), pytest.importorskip("polars")
    table, by_pandas, by_polars = run.to_table(), run.to_pandas(), run.to_polars()
    assert isinstance(by_pandas, pandas.DataFrame)
    assert isinstance(by_polars, polars.DataFrame)
    assert list(by_pandas.columns) == by_polars.columns == table.column_names
    for name in table.column_names:
        expected = table[name].to_numpy()
        np.testing.assert_array_equal(by_pandas[name].to_numpy(), expected)
        np.testing.assert_array_equal(by_polars[name].to_numpy(), expected)
        assert by_polars[name].to_numpy().dtype == expected.dtype == by_pandas[name].dtype


@pytest.mark.parametrize(
    ("call", "library"),
    [("to_table", "pyarrow"), ("to_pandas", "pandas"), ("to_polars", "polars"), ("to_pandas", "pyarrow")],
)
def test_a_library_that_is_missing_is_one_clear_line(call, library, monkeypatch):
    run = simulate(load_scene("two_anchor_a"), 0.1)
    if call != f"to_{library}" and library == "pyarrow" and call != "to_table":
        pytest.importorskip("pandas")
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(
        CrawlerError, match=rf"^{call}: {library} is not installed; pip install 'crawler-ros\[tables\]'$"
    ):
        getattr(run, call)()


def test_a_segment_with_the_name_of_a_column_is_refused():
    document = load_scene("segment_climber").document()
    document["body"]["segments"][0]["name"] = "work"
    run = simulate(Scene.model_validate(document), 0.1)
    with pytest.raises(CrawlerError, match=r"^to_table: the segment work has the name of a column .*; rename it$"):
        run.to_table()
