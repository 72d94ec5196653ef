"""Speed against error: the command's contract, and peers that truly solve our problem. No test looks at a time."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from crawler_bench.bench import choose_cases
from crawler_bench.cases import CASES, PERIODS, QUARTERS, Case, wave_scene
from crawler_bench.entrants import mujoco as mujoco_peer
from crawler_bench.entrants import ode as ode_peer
from crawler_bench.entrants import ours
from crawler_bench.entrants import planar as planar_peer
from crawler_bench.entrants.entrant import Entrant
from crawler_bench.entrants.qp import BACKENDS, QpRun
from crawler_bench.features.films import measure_films
from crawler_bench.features.gradients import measure_gradients
from crawler_bench.features.growth import DRIVES, fit_exponent, measure_growth
from crawler_bench.features.identify import TASKS, TUNED, build_spec, load_sysid, measure_identify
from crawler_bench.features.search import measure_search
from crawler_bench.features.springs import LINKS, measure_springs
from crawler_bench.features.sweep import measure_sweep
from crawler_bench.features.turning import measure_turning
from crawler_command.app import main
from crawler_model import Crawler, CrawlerError, Scene

from ..model.chains import from_rows
from .test_command import CRAWLER, bad, good

KEYS = {"case": str, "n": int, "method": str, "us_per_tick": float, "error": float, "solved": bool}


def displacement(entrant: Entrant) -> np.ndarray:
    run = entrant.start()
    found = []
    for number in range(QUARTERS):
        run.quarter(number, math.inf)
        found.append(np.array(run.displacement))
    assert run.failures == 0
    return np.array(found)


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    command = [CRAWLER, "bench", "--quick", "--case", "strategy_a", "--json", "--out", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True)  # solvers print past Python
    assert done.returncode == 0, done.stderr
    assert done.stderr == "" or "compiling" in done.stderr
    return json.loads(done.stdout, parse_constant=lambda name: pytest.fail(f"{name} in the JSON")), folder


def test_the_json_is_that_of_the_contract(quick):
    result, folder = quick
    assert json.loads((folder / "speed_against_error.json").read_text()) == result
    for row in result["rows"]:
        for key, kind in KEYS.items():
            stopped = row[key] is None and not row["solved"]  # on a machine that is busy with something else
            assert isinstance(row[key], kind) or stopped, (key, row)
    for key in ("cpu", "cores", "python", "numpy", "numba", "osqp", "mujoco", "load_average", "threads"):
        assert result["machine"][key] is not None
    methods = {row["method"] for row in result["rows"]}
    assert methods >= {"exact", "catch_up", "catch_up, one call a tick", "DAQP", "ProxQP", "MuJoCo, tuned"}
    assert methods >= {
        "OSQP 1e-3",
        "OSQP 1e-6",
        "OSQP 1e-9",
        "OSQP polished",
        "Clarabel 1e-9",
        "PIQP 1e-9",
        "smooth friction, LSODA",
    }
    assert any("MuJoCo" in ratio["what"] for ratio in result["ratios"])


def test_exact_is_exact_and_peers_are_as_good_as_they_say(quick):
    rows = quick[0]["rows"]
    rows = [row for row in rows if row["error"] is not None]
    exact = [row["error"] for row in rows if row["method"].startswith("exact")]
    assert max(exact) <= 1e-12
    osqp = [row["error"] for row in rows if row["method"] == "OSQP 1e-9"]
    assert max(exact) < min(osqp)
    assert max(osqp) < 1e-8
    assert min(row["error"] for row in rows if row["method"].startswith("MuJoCo")) < 3e-3
    assert min(row["error"] for row in rows if row["method"].startswith("smooth")) < 1e-4


def test_the_reference_is_vouched_for(quick):
    certificate = quick[0]["references"]["strategy_a"]
    assert certificate["reference"] == "rational"
    assert {row["reference"] for row in quick[0]["rows"]} == {"rational"}
    assert certificate["rational_difference"] < 1e-15
    assert certificate["closed_form_difference"] < 1e-14
    assert certificate["energy_residual"] < 1e-14


def test_the_picture_shows_something(quick):
    from matplotlib.image import imread

    picture = imread(quick[1] / "strategy_a.png")[:, :, :3]
    assert picture.shape[0] > 600
    assert len(np.unique((picture.reshape(-1, 3) * 255).astype(int), axis=0)) > 50


def test_for_people(tmp_path):
    text = good("bench", "--quick", "--case", "graph", "--out", str(tmp_path))
    assert "graph: three contacts" in text
    assert "ratios within this run" in text
    assert "left out: MuJoCo on graph: friction differs" in text
    assert (tmp_path / "graph.png").stat().st_size > 20_000


def test_an_unknown_case_is_one_line(tmp_path):
    text = bad("bench", "--case", "strategie", cwd=tmp_path)
    assert "unknown case 'strategie'; the nearest is 'strategy_a'" in " ".join(text.split())
    assert not (tmp_path / "bench").exists()


def test_a_quick_run_leaves_the_long_cases_out_unless_they_are_named():
    assert "wave_10000" not in choose_cases((), True)
    assert choose_cases((), False) == list(CASES)
    assert choose_cases(("planar", "wave_10000"), True) == ["wave_10000", "planar"]
    with pytest.raises(CrawlerError, match="planar_turning"):
        choose_cases(("planar_turnin",), True)


@pytest.mark.parametrize("name", ["strategy_a", "peristaltic", "segment", "graph", "planar"])
def test_references_keep_their_energy_account_and_closed_forms(name):
    certificate = CASES[name]().reference.certificate
    assert certificate["energy_residual"] < 1e-14
    assert certificate.get("closed_form_difference", 0.0) < 1e-14
    assert certificate.get("rational_difference", 0.0) < 1e-14


@pytest.mark.parametrize("commanded", [False, True], ids=["constant friction", "commanded friction"])
@pytest.mark.parametrize("contacts", [2, 3, 10, 30])
@pytest.mark.parametrize("name", BACKENDS)
def test_multipliers_are_the_displacements_of_a_catch_up_step(name, contacts, commanded):
    rng = np.random.default_rng(contacts)
    actuation = np.vstack((np.zeros(contacts - 1), rng.uniform(-1.0, 1.0, (6, contacts - 1))))
    forward, backward = rng.uniform(0.5, 1.5, (2, 7, contacts))
    if not commanded:
        forward[:], backward[:] = forward[0], backward[0]
    scene = from_rows(rng.uniform(0.5, 2.0, contacts - 1), actuation, forward, backward)
    targets = scene.drive.targets[1:]
    backend = BACKENDS[name]
    for tolerance in backend.tolerances:
        run, exact = QpRun(scene, (targets,) * 4, backend, tolerance), Crawler(scene, "catch_up")
        run.quarter(0, math.inf)
        exact.follow(targets)
        assert run.failures == 0
        assert np.abs(exact.displacement).max() > 0.1
        # a gap of the size of the tolerance leaves its root in the unknowns; frictions have sums of the order of N
        close = 10.0 * contacts * (tolerance if name in ("OSQP", "OSQP polished", "DAQP") else math.sqrt(tolerance))
        assert np.abs(run.displacement - exact.displacement).max() < close, tolerance


def test_a_cone_program_takes_the_step_of_a_crawler_on_a_line():
    case = CASES["planar"]()
    entrant = planar_peer.build_cone_peers(case, (4,))[-1]
    assert case.reference.error(displacement(entrant)) < 1e-3


def test_smooth_friction_converges_with_its_smoothing():
    case = CASES["strategy_a"]()
    errors = [case.reference.error(displacement(e)) for e in ode_peer.build_ode_peers(case, (1e-2, 1e-4))]
    assert errors[1] < 0.05 * errors[0] < 0.01


def test_mujoco_is_not_asked_for_what_it_does_not_have():
    assert mujoco_peer.why_not(CASES["strategy_a"]()) is None
    assert "forwards and backwards" in str(mujoco_peer.why_not(CASES["peristaltic"]()))


def test_our_methods_agree_however_they_are_called():
    case = Case("small", "a small wave", wave_scene(12, 6.3))
    together, single = ours.build_ours(case, (), (64,), (64,))[::2][0], ours.build_ours(case, (), (64,), (64,))[-1]
    assert np.array_equal(displacement(together), displacement(single))
    exact = ours.build_ours(case, (4, 256), (), ())
    size = np.abs(case.reference.displacement).max()
    assert np.abs(displacement(exact[0]) - displacement(exact[1])).max() < 1e-13 * size
    run = exact[0].start()
    spent, periods = run.lap(0, math.inf)
    assert spent > 0.0
    assert periods >= 1


def test_a_lap_goes_on_where_the_last_one_stopped():
    case = CASES["strategy_a"]()
    run = ours.build_ours(case, (4,), (), ())[0].start()
    for number in range(4 * PERIODS):
        run.quarter(number, math.inf)
    before = float(np.mean(run.displacement))
    run.lap(4 * PERIODS, math.inf)
    gained = float(np.mean(run.displacement)) - before
    assert gained / 2.0 == pytest.approx(round(gained / 2.0), abs=1e-9)  # 2 m a period
    assert gained >= 2.0


def test_no_peer_is_imported_before_it_is_measured():
    code = (
        "import sys, crawler_model, crawler_command.app, crawler_bench.bench, crawler_bench.entrants.qp, crawler_bench.entrants.mujoco;"
        "print([m for m in ('osqp', 'daqp', 'piqp', 'proxsuite', 'mujoco', 'matplotlib', 'clarabel') if m in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"


def test_without_peers_one_line_says_how_to_get_them(tmp_path):
    code = (
        "import sys, importlib.util as u; f = u.find_spec;"
        "u.find_spec = lambda name, *a: None if name in ('osqp', 'mujoco', 'daqp', 'piqp', 'proxsuite') else f(name, *a);"
        f"sys.argv = ['crawler', 'bench', '--quick', '--case', 'strategy_a', '--json', '--out', {str(tmp_path)!r}];"
        "from crawler_command.app import main; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    said = [line for line in done.stderr.splitlines() if "compiling" not in line]
    assert len(said) == 1
    assert "OSQP, DAQP, PIQP, ProxQP, MuJoCo not installed" in said[0]
    assert "pip install 'crawler-ros[bench]'" in said[0]
    methods = {row["method"].split()[0].strip(",") for row in json.loads(done.stdout)["rows"]}
    assert methods == {"exact", "catch_up", "Clarabel", "smooth"}


def test_without_matplotlib_one_line(tmp_path):
    code = "import sys; sys.modules['matplotlib'] = None; sys.argv = ['crawler', 'bench', '--quick']; from crawler_command.app import main; main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
    assert "matplotlib is not installed" in done.stderr


def test_scenes_of_cases_are_scenes():
    assert Scene.model_validate(CASES["planar_turning"]().scene.document()).dimension == 2


def test_runs_of_many_variations_are_measured():
    rows = measure_sweep(20, lambda part: None)
    assert {row["workers"] for row in rows} == {1, 2}
    assert {row["n"] for row in rows} >= {2, 3, 10}
    for row in rows:
        assert row["runs_per_s"] > 0.0
        assert 0.0 < row["in_kernels"] <= 1.0


@pytest.mark.slow
def test_steps_of_environments_are_measured():
    pytest.importorskip("gymnasium")
    from crawler_bench.features.environments import measure_environments

    rows = [row for row in measure_environments(30, lambda part: None) if row["environment"] == "Crawler-v0"]
    assert [(row["n"], row["environments"]) for row in rows] == [(n, m) for n in (3, 10) for m in (1, 64, 1024)]
    for row in rows:
        assert 0.0 < row["least"] <= row["steps_per_s"] <= row["most"]


def test_environments_that_are_not_installed_are_named(monkeypatch, capsys, tmp_path):
    environments = pytest.importorskip("crawler_bench.features.environments")
    for module in ("mujoco", "gym_softrobot"):
        monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setattr(environments, "QUICK", 3)
    with pytest.raises(SystemExit) as left:
        main(["bench", "--gym", "--quick", "--json", "--out", str(tmp_path)])
    assert not left.value.code
    out, said = capsys.readouterr()
    assert {row["environment"] for row in json.loads(out)["rows"]} == {"Crawler-v0"}
    assert [line for line in said.splitlines() if "compiling" not in line] == [
        "crawler: Swimmer-v5, HalfCheetah-v5 not installed or not starting, and left out; "
        "install with: pip install 'crawler-ros[bench]'",
        "crawler: OctoFlat-v0 not installed or not starting, and left out; install with: pip install 'gym-softrobot'",
    ]


def test_an_environment_that_does_not_start_is_left_out(monkeypatch, tmp_path):
    """As one that uses what NumPy has dropped: importing it raises no ImportError."""
    environments = pytest.importorskip("crawler_bench.features.environments")
    (tmp_path / "gym_softrobot.py").write_text("import numpy\n\nnumpy.float\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "gym_softrobot", raising=False)
    assert environments.missing_peers()["OctoFlat-v0"] == "gym-softrobot"


@pytest.mark.slow
def test_exact_derivatives_are_measured_beside_differences():
    rows = measure_gradients((2, 3), lambda part: None)
    assert [(row["n"], row["method"]) for row in rows] == [
        (n, method) for n in (2, 3) for method in ("exact", "differences")
    ]
    for row in rows:
        assert row["ms"] > 0.0
        assert row["error"] < (1e-9 if row["method"] == "exact" else 1e-3)


def test_the_search_is_measured_beside_general_optimisers():
    pytest.importorskip("cma")
    rows = {row["method"]: row for row in measure_search(0.5, lambda part: None)}
    assert {"crawler optimise", "cma", "slsqp"} <= set(rows)
    assert max(row["within_1_percent"] for row in rows.values()) >= 1
    for row in rows.values():
        assert 0.0 < row["median"] <= row["best"] <= 0.22 + 1e-9


needs_sysid = pytest.mark.skipif(load_sysid() is None, reason="mujoco.sysid is not installed")


def test_mujoco_with_springs_as_actuators_moves_like_the_tuned_chain():
    mujoco = pytest.importorskip("mujoco")
    scene, steps = TASKS[0].scene(start=False), 300
    run = mujoco_peer.MujocoRun(scene, steps, TUNED["sliding", steps])
    model = build_spec(scene, steps, TUNED["sliding", steps]).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = scene.start_displacement
    for quarter in range(8):
        run.quarter(quarter, math.inf)
        for control in run.actuation[(quarter % 4) * 75 :][:75] - 1000.0:
            data.ctrl[:] = control
            mujoco.mj_step(model, data)
        assert data.qpos == pytest.approx(run.displacement, abs=1e-8)
    assert np.ptp(run.displacement - scene.start_displacement) > 0.01


@needs_sysid
def test_identification_is_measured_beside_mujoco():
    rows = measure_identify((300,), lambda part: None, TASKS[1:2])
    assert [row["noise"] for row in rows] == [0.0, 0.0, 0.01, 0.01]
    for own, peer in (rows[:2], rows[2:]):
        assert (own["method"], peer["method"]) == ("crawler identify", "mujoco.sysid, 300 steps/s")
        assert own["called_determined"] == 0
        assert own["ratio_error"] < peer["ratio_error"] < 0.2
        assert peer["of_these_not"] == peer["called_determined"]
        assert min(own["rollouts"], peer["rollouts"]) > 1
    assert rows[0]["ratio_error"] < 1e-9


@pytest.mark.slow
def test_without_mujoco_sysid_our_identification_is_measured_alone(tmp_path):
    code = (
        "import sys; sys.modules['absl'] = None;"
        f"sys.argv = ['crawler', 'bench', '--identify', '--quick', '--json', '--out', {str(tmp_path)!r}];"
        "from crawler_command.app import main; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    said = [line for line in done.stderr.splitlines() if "compiling" not in line]
    assert said == [
        "crawler: mujoco.sysid not installed or not starting, and left out; "
        "install with: pip install 'mujoco[sysid]>=4,<5'"
    ]
    rows = json.loads(done.stdout)["rows"]
    assert json.loads((tmp_path / "identify.json").read_text())["rows"] == rows
    cameras = [row for row in rows if row["case"] == "coverage"]
    assert {"white", "pixels", "dropped frames"} < {row["measurement"] for row in cameras}
    assert all(row["covered_percent"] > 60.0 for row in cameras)
    rows = [row for row in rows if row["case"] == "identify"]
    assert [row["called_determined"] for row in rows] == [3, 3, 0, 0, 2, 2]
    for row in rows:
        assert row["of_these_not"] == row["missed"] == 0
        if row["worst_error"] is not None:
            assert row["worst_error"] < (0.02 if row["noise"] else 1e-9)


def test_films_are_measured():
    pytest.importorskip("matplotlib")
    rows = measure_films(5, lambda part: None, ("two_anchor_a",))
    assert {row["case"] for row in rows} == {"frames drawn", "films written"}
    assert {(row["n"], row["frames"]) for row in rows} == {(2, 5)}
    assert {row["output"] for row in rows if "output" in row} >= {"gif", "html"}
    assert all(row["frames_per_s"] > 0.0 for row in rows)


def test_the_growth_of_the_time_of_a_ramp_is_measured_on_all_drives():
    drives = {name: replace(drive, sizes=(25, 49)) for name, drive in DRIVES.items()}
    rows = measure_growth(math.inf, lambda part: None, drives)
    measured, fitted = ([row for row in rows if ("drive" in row) == fits] for fits in (False, True))
    assert {row["case"] for row in measured} == {row["drive"] for row in fitted} == set(DRIVES)
    for row in measured:
        assert row["ms"] > 0.0
        assert row["overspent"] == 0
        assert row["note"] == ""
        assert (row["exponent"] is None) == (row["n"] == 25)
        assert row["method"] == "exact" or row["to_catch_up"] == 1.0
    for row in fitted:
        assert (row["from"], row["to"], row["note"]) == (25, 49, "")
        last = next(r for r in measured if (r["case"], r["method"], r["n"]) == (row["drive"], row["method"], 49))
        assert row["exponent"] == last["exponent"]


def test_ticks_of_all_kinds_of_links_are_measured_beside_linear_ones():
    rows = measure_springs((10,), lambda part: None)
    assert [row["links"] for row in rows] == list(LINKS)
    for row in rows:
        assert row["us_per_tick"] == pytest.approx(row["us_per_piece"] * row["pieces"])
        assert row["to_linear"] == pytest.approx(row["us_per_tick"] / rows[0]["us_per_tick"])
        assert row["overspent"] == 0
    pieces = {row["links"]: row["pieces"] for row in rows}
    assert pieces["motor that never stalls"] == pieces["linear"] < min(pieces["stops"], pieces["motor that stalls"])


@pytest.mark.slow
def test_bodies_that_turn_are_measured_beside_peers():
    pytest.importorskip("mujoco")
    found = measure_turning((3,), lambda part: None)
    rows, continuous = ([row for row in found if (row["case"] == "continuous snake") == flag] for flag in (False, True))
    errors = {row["setting"]: row["error"] for row in rows}
    for row in rows:
        assert 0.0 < row["us_per_tick"] == pytest.approx(1e3 * row["ms_per_period"] / row["ticks"])
    assert errors["tolerance 1e-07"] < 1e-6 < errors["tolerance 1e-05"] < 1e-4
    assert errors["10000 steps"] < errors["3000 steps"] < errors["1000 steps"] < 0.05
    assert errors["10000 steps"] < 3e-3
    assert [row["n"] for row in continuous if row["method"] == "crawler"] == [10]


def test_a_body_for_which_the_time_does_not_suffice_is_named():
    rows = measure_growth(0.0, lambda part: None, {"five waves": DRIVES["five waves"]})
    assert [(row["case"], row["method"]) for row in rows[:2]] == [("five waves", "catch_up"), ("five waves", "exact")]
    for row in rows[:2]:
        assert row["ms"] is None
        assert row["note"].startswith("left out after")
    for row in rows[2:]:
        assert (row["from"], row["to"], row["exponent"]) == (1_000, None, None)
        assert row["note"].startswith("N = 1000: left out after")


def test_an_exponent_is_fitted_to_all_sizes():
    sizes = np.array([10, 30, 100, 300])
    assert fit_exponent(sizes, 2.0 * sizes**1.5) == pytest.approx(1.5)
    bent = [1.0, 1.0, 1.0, 4.0]
    slope = np.cov(np.log(sizes), np.log(bent))[0, 1] / np.var(np.log(sizes), ddof=1)
    assert fit_exponent(sizes, bent) == pytest.approx(slope)
    assert fit_exponent([10], [1.0]) is None
