"""Springs that remember, found from loops: Masing's branches, intervals, the rate, and what is no such loop."""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np
import pytest
import yaml

from crawler_command.app import main
from crawler_lab.springs.loop import Shape, build_path, compute_force, find_reversals
from crawler_lab.springs.springs import fit_springs
from crawler_model import CrawlerError, Scene, simulate

from .loops import STEP_S, noise, stop, walk

RUBBER = ((40.0, 0.1), (10.0, 0.1))


def parameters(stiffness, elements, starts=None):
    starts = starts or [0.0] * len(elements)
    return np.array([0.0, stiffness, *(v for (k, f), s in zip(elements, starts, strict=True) for v in (f, f / k, s))])


def test_every_branch_is_the_first_one_twice_as_large():
    z = walk(40, (0.0, 1.0, -0.8, 0.6, -0.3, 0.2, -0.1))
    force = compute_force(build_path(z), Shape(0, 2), parameters(20.0, RUBBER))[0]

    def first(way):
        return 20.0 * way + sum(np.clip(k * way, -f, f) for k, f in RUBBER)

    ends = find_reversals(z, 0.0)
    assert ends.size == 7
    for a, b in pairwise(ends[1:]):
        branch = force[a] + 2.0 * first((z[a : b + 1] - z[a]) / 2.0)
        assert force[a : b + 1] == pytest.approx(branch, abs=1e-13)


def test_the_elements_are_those_of_a_scene():
    """A contact slides to and fro on ground that holds little; the tension of its link follows the model here."""
    link = {"stiffness": 20.0, "hysteresis": [{"stiffness": k, "yield": f} for k, f in RUBBER]}
    actuation = [[0.0], [0.1], [-0.05], [0.07], [0.0], [0.1]]
    scene = Scene.model_validate(
        {
            "name": "frame",
            "body": {"contacts": [0.0, 0.3], "links": [link]},
            "friction": {"forward": [100.0, 0.01], "backward": [100.0, 0.01]},
            "drive": {"times": list(range(6)), "actuation": actuation},
            "start": {"displacement": [0.0, 0.0]},
        }
    )
    run = simulate(scene, 5.0, 100.0)
    z = run.displacement[:, 1] - run.displacement[:, 0]
    assert np.ptp(z) > 0.1
    rest = np.interp(run.time, range(6), np.array(actuation)[:, 0])
    force = compute_force(build_path(z), Shape(0, 2), parameters(20.0, RUBBER))[0]
    assert run.tension[:, 0] == pytest.approx(force - 20.0 * rest, abs=1e-12)


def test_derivatives_are_those_of_differences():
    z = walk(50)
    x = np.array([0.3, 20.0, 35.0, 12.0, 0.03137, 0.06241, 0.2, 0.0123, 0.4, 0.5, 0.0311, -0.7])
    shape, path = Shape(2, 2), build_path(z)
    derivatives = compute_force(path, shape, x)[1]
    for i in range(shape.size):
        step = np.where(np.arange(shape.size) == i, 1e-7, 0.0)
        change = (compute_force(path, shape, x + step)[0] - compute_force(path, shape, x - step)[0]) / 2e-7
        assert np.abs(derivatives[i] - change).max() < 1e-6 * max(np.abs(change).max(), 1.0), i


def test_a_loop_without_noise_gives_its_numbers_back():
    z = walk(60)
    bent = 2.0 + 20.0 * z + 15.0 * np.maximum(z - 0.05, 0.0)
    found = fit_springs("loop", z, bent + stop(z, 40.0, 0.2, 0.05) + stop(z, 15.0, 0.4, -0.1))
    assert [one.value for one in found.stiffnesses] == pytest.approx([20.0, 35.0], rel=1e-4)
    assert [one.value for one in found.knots] == pytest.approx([0.05], rel=1e-4)
    pairs = [(one.stiffness.value, one.limit.value, one.start) for one in found.elements]
    assert np.array(pairs) == pytest.approx(np.array([[40.0, 0.2, 0.05], [15.0, 0.4, -0.1]]), rel=1e-3)
    assert found.force_at_zero.value == pytest.approx(2.0, rel=1e-4)
    assert found.explained
    assert found.rate is None


def test_a_spring_that_does_not_remember_has_no_elements():
    z = walk(60)
    found = fit_springs("loop", z, 1.0 + 20.0 * z + noise(np.random.default_rng(0), z.size, 0.01))
    assert (found.elements, found.knots) == ((), ())
    assert "hysteresis" not in found.scene_lines()


def test_what_a_record_only_bounds_has_one_end():
    """An element that yields beyond half of the strokes, or within a step of the rows."""
    z = walk(100)
    shaken = 20.0 * z + noise(np.random.default_rng(3), z.size, 0.002)
    strong = fit_springs("loop", z, shaken + stop(z, 40.0, 0.2, 0.0) + stop(z, 10.0, 0.7, 0.0))
    *_, last = strong.elements
    assert last.limit.low < 0.7
    assert last.limit.high is None
    assert strong.force_at_zero.low is None
    assert any("measure longer ones" in note for note in strong.notes)
    stiff = fit_springs("loop", z, shaken + stop(z, 1e4, 0.2, 0.0))
    assert stiff.elements[0].stiffness.low < 1e4
    assert stiff.elements[0].stiffness.high is None
    assert stiff.elements[0].limit.low < 0.2 < stiff.elements[0].limit.high


def test_an_element_that_yields_once_has_no_largest_yield_whatever_the_noise():
    """Of 15 mm in strokes of 20 mm the way out shows where it yields, with a first force that is not known."""
    z = walk(700, (0.0, 1.0, 0.0, 0.5, 0.1, 1.0), 0.02)
    force = 18.0 * z + stop(z, 4.0, 0.02, 0.0) + stop(z, 2.0, 0.03, 0.0)
    for seed in range(3):
        found = fit_springs("loop", z, force + np.random.default_rng(seed).normal(0.0, 1e-3, z.size))
        slow = found.elements[-1].limit
        assert slow.high is None
        assert slow.low < 0.03
        assert found.force_at_zero.low is None


def test_intervals_contain_the_truth_as_often_as_they_announce():
    inside, wrong = [], 0
    for seed in range(20):
        rng = np.random.default_rng(1000 + seed)
        count = 1 + seed % 3
        reach = 0.004 * np.cumprod(np.append(rng.uniform(1.0, 2.0), rng.uniform(1.8, 2.2, count - 1)))
        limit, start = rng.uniform(0.2, 0.6, count), rng.uniform(-1.0, 1.0, count)
        offset, stiffness = rng.uniform(-1.0, 1.0), rng.uniform(10.0, 40.0)
        z = walk(100)
        force = offset + stiffness * z + noise(rng, z.size, 0.01, 0.01 * (seed % 2))
        force += sum(stop(z, f / r, f, s * f) for f, r, s in zip(limit, reach, start, strict=True))
        found = fit_springs("loop", z, force, STEP_S * np.arange(z.size))
        if len(found.elements) != count or found.knots:
            wrong += 1
            continue
        truth = [offset, stiffness, *(limit / reach), *limit]
        said = [found.force_at_zero, *found.stiffnesses]
        said += [one.stiffness for one in found.elements] + [one.limit for one in found.elements]
        inside += [one.low <= value <= one.high for one, value in zip(said, truth, strict=True)]
    assert wrong <= 1
    assert len(inside) > 100
    assert 0.9 < np.mean(inside) < 1.0


def at_two_speeds(viscosity: float, slow: int = 150, fast: int = 30) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A record at two speeds with a dashpot parallel to the spring [N s/m]: elongation, force, time."""
    z = np.concatenate((walk(slow), walk(fast)[1:]))
    time = STEP_S * np.arange(z.size)
    force = 20.0 * z + stop(z, 40.0, 0.2, 0.0) + viscosity * np.gradient(z, time)
    return z, force + noise(np.random.default_rng(1), z.size, 0.005), time


def test_the_rate_is_judged_by_the_difference_of_two_speeds():
    z, force, time = at_two_speeds(0.0)
    rate = fit_springs("loop", z, force, time).rate
    assert rate.verdict == "rate independent"
    assert rate.difference < 0.005
    assert rate.speeds[1] > 4.0 * rate.speeds[0]
    z, force, time = at_two_speeds(1.0)
    rate = fit_springs("loop", z, force, time).rate
    assert rate.verdict == "depends on the rate"
    expected = np.abs(np.diff(walk(30))).mean() / STEP_S - np.abs(np.diff(walk(150))).mean() / STEP_S  # times 1 N s/m
    assert rate.difference == pytest.approx(expected, rel=0.2)
    assert rate.part == pytest.approx(rate.difference / 0.5, rel=0.3)
    z, force, time = at_two_speeds(1.0, 100, 100)
    rate = fit_springs("loop", z, force, time).rate
    assert (rate.verdict, rate.difference) == ("one speed only", None)


def run(capsys, *arguments):
    with pytest.raises(SystemExit) as stopped:
        main([str(a) for a in arguments])
    out, err = capsys.readouterr()
    return int(stopped.value.code or 0), out, err


def write(path, z, force, time, header="", delimiter=","):
    rows = [delimiter.join(repr(float(v)) for v in row) for row in zip(z, force, time, strict=True)]
    path.write_text("\n".join(([header] if header else []) + rows) + "\n", encoding="utf-8")
    return path


def test_tables_are_read_as_laboratories_write_them(tmp_path, capsys):
    z, force, time = at_two_speeds(0.0, 100, 20)
    plain = write(tmp_path / "plain.csv", z, force, time)
    code, out, err = run(capsys, "springs", plain, "--json")
    assert (code, err) == (0, "")
    first = json.loads(out)
    assert first["rows"] == z.size
    assert first["rate"]["verdict"] == "rate independent"
    named = write(tmp_path / "named.txt", 1e3 * time, 1e3 * z, force, "t;Weg;Kraft", ";")
    named.write_text(named.read_text(encoding="utf-8").replace(".", ","), encoding="utf-8")
    names = "elongation=Weg,force=Kraft,time=t"
    second = json.loads(run(capsys, "springs", named, "--json", "--units", "mm,ms", "--columns", names)[1])
    for one, two in zip(first["hysteresis"], second["hysteresis"], strict=True):
        assert one["yield"]["value"] == pytest.approx(two["yield"]["value"], rel=1e-6)
        assert one["stiffness"]["value"] == pytest.approx(two["stiffness"]["value"], rel=1e-6)
    assert first["force_at_zero"]["value"] == pytest.approx(second["force_at_zero"]["value"], abs=1e-6)


def test_text_picture_and_lines_for_a_scene(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    from PIL import Image

    z = walk(100)
    force = 20.0 * z + 15.0 * np.maximum(z - 0.05, 0.0) + stop(z, 40.0, 0.2, 0.0) - 0.3
    force += noise(np.random.default_rng(2), z.size, 0.003)
    table = write(tmp_path / "loop.csv", z, force, STEP_S * np.arange(z.size), "elongation,force,time")
    code, out, err = run(capsys, "springs", table, "--png", tmp_path / "loop.png")
    assert (code, err) == (0, "")
    assert "The model explains the loop" in out
    assert "one speed only" in out
    assert len(np.unique(np.asarray(Image.open(tmp_path / "loop.png").convert("L")))) > 20
    links = yaml.safe_load(out.split("For the scene file:")[1])["links"]
    scene = {"name": "found", "body": {"contacts": [0.0, 0.1], "links": links}, "friction": {"isotropic": 1.0}}
    assert Scene.model_validate(scene).name == "found"
    curve, (element,) = links[0]["curve"], links[0]["hysteresis"]
    at = np.interp([0.0, 0.03, 0.09], curve["elongation"], curve["tension"])
    assert at == pytest.approx([-0.3, 0.3, 2.1], abs=0.02)
    assert (element["stiffness"], element["yield"]) == pytest.approx((40.0, 0.2), rel=0.05)
    code, _, err = run(capsys, "springs", table, "--png", tmp_path / "loop.png")
    assert (code, "exists already" in err) == (1, True)


def test_a_loop_that_grows_with_tension_is_no_loop_of_such_elements(tmp_path, capsys):
    """A cable in a sheath: friction is a part of the tension."""
    z = walk(200, (0.0, 1.0, 0.0, 1.0, 0.0), 0.3)
    force = (2.0 + 30.0 * z) * (1.0 + stop(z, 100.0, 0.6, 0.0))
    table = write(tmp_path / "sheath.csv", 1e3 * z, force, STEP_S * np.arange(z.size))
    code, out, err = run(capsys, "springs", table, "--units", "mm")
    assert code == 1
    assert "friction that grows with tension" in out
    assert err.count("\n") == 1
    assert "sheath.csv: the model does not explain the loop" in err
    assert "is `--units mm` missing?" in run(capsys, "springs", table)[1]


@pytest.mark.parametrize("columns", [(0, 1), (1, 0)])
def test_columns_that_are_negated_or_exchanged_are_named(columns, tmp_path, capsys):
    """Such a loop would give energy. No loop is open then, and the change between speeds is told in newtons."""
    z, force, time = at_two_speeds(0.0, 100, 20)
    right = np.array([z, force])
    wrong = right * [[-1.0], [1.0]] if columns == (0, 1) else right[::-1]
    for (elongation, pull), named in ((right, False), (wrong, True)):
        code, out, _ = run(capsys, "springs", write(tmp_path / "loop.csv", elongation, pull, time))
        assert code == int(named)
        assert ("are elongation and force exchanged, or is one of them negated?" in out) == named
        assert "loops at two, one twice the other" not in out


def rows(*lines):
    return "\n".join(lines) + "\n"


LOOP = [f"{0.001 * k},{0.02 * k}" for k in (*range(30), *range(30, 0, -1))]
MISTAKES = [
    ("no column `force`", rows("0.1", "0.2", "0.3")),
    ("no column `elongation`; the header is x,force", rows("x,force", *LOOP)),
    ("3 rows with an elongation and a force", rows("0,0", "1,1", "0,0")),
    ("no reversal", rows(*LOOP[:30], "0.03,nan", "0.031,0.6")),
    ("no reversal", rows(*["0.1,1"] * 40)),
    ("row 3: 'x' is not a number", rows("elongation,force", "0,0", "x,1", *LOOP)),
    ("it must increase", rows("elongation,force,time", *(f"{line},{k // 2}" for k, line in enumerate(LOOP)))),
    ("must be at most", rows(*LOOP, "inf,1")),
]


@pytest.mark.parametrize(("said", "text"), MISTAKES, ids=[f"{k} {said}" for k, (said, _) in enumerate(MISTAKES)])
def test_mistakes_in_tables_are_named_in_one_line(said, text, tmp_path, capsys):
    (tmp_path / "table.csv").write_text(text, encoding="utf-8")
    code, out, err = run(capsys, "springs", tmp_path / "table.csv")
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert said in err


def test_mistakes_in_options_are_named_in_one_line(tmp_path, capsys):
    (tmp_path / "table.csv").write_text(rows(*LOOP), encoding="utf-8")
    for option, value, said in (
        ("--units", "furlong", "'furlong' is not known"),
        ("--columns", "strain=a", "a loop has the columns elongation, force, time"),
        ("--columns", "force=load", "has no column load; it has elongation,force"),
        ("--png", tmp_path / "loop.jpg", "must end in .png"),
    ):
        code, out, err = run(capsys, "springs", tmp_path / "table.csv", option, value)
        assert (code, out, err.count("\n")) == (1, "", 1)
        assert said in err
    assert "no such file" in run(capsys, "springs", tmp_path / "nowhere.csv")[2]


def test_too_few_rows_are_refused_in_python():
    with pytest.raises(CrawlerError, match="a loop needs 30"):
        fit_springs("loop", np.zeros(3), np.zeros(3))
