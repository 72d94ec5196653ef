"""Compare the model with published crawlers: the tables and the figure of validation.md.

Published numbers stand here as constants, each with its source in validation.md; all others are computed. The script
prints the rows of the tables as they stand in the page, then draws the figure.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import least_squares

from crawler_lab import simulate_many, vary
from crawler_model import Scene, Trajectory, load_scene, simulate, steepest_climb

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PICTURE = Path(__file__).parent / "pictures" / "validation.png"
PRESSURES = (100.0, 150.0, 200.0, 250.0)
"""Of the soft inchworm, in the unit of its data."""
MATERIALS = {"iron": 0.27, "rubber": 0.58, "plastic": 0.84, "paper": 1.19, "glass": 2.75}
"""Its grounds and their friction coefficients."""
STEPS = {
    "iron": ((0.2, 9.0, 11.9, 14.7), (0.2, 2.5, 1.8, 2.3)),
    "rubber": ((1.1, -1.1, 6.2, 10.3), (1.1, 4.5, 2.3, 2.2)),
    "plastic": ((1.4, 4.3, 8.2, 10.7), (1.6, 1.3, 2.3, 2.7)),
    "paper": ((-0.2, -0.2, 0.9, 3.4), (0.2, 0.1, 0.9, 0.6)),
    "glass": ((-0.2, 0.8, 4.1, 7.0), (0.8, 2.6, 2.5, 2.9)),
}
"""Its step, velocity over frequency: mean and standard deviation over five frequencies, at each pressure."""
EXPONENTS = {"iron": -0.27, "rubber": -0.32, "plastic": 0.50, "paper": 0.32, "glass": 0.99}
"""b of step ~ frequency^b at the largest pressure, fitted over 0.125 .. 0.4 Hz."""
FITTED = ("iron", "rubber", "plastic", "paper")
SKINS = {
    "anodized aluminium": (0.43, 0.43),
    "floor tiles, new": (0.44, 0.57),
    "polished wood": (0.44, 0.68),
    "concrete brick": (0.67, 1.52),
    "composite wood": (0.43, 1.42),
    "corrugated sheet": (0.506, 1.463),
    "carpet": (0.55, 4.01),
}
"""Friction coefficients of the skin of a modular inchworm on seven grounds, forward and backward."""
SPEEDS = {4.0: 9.0, 2.0: 3.5, 1.0: 30.0, 0.5: 30.0}
"""Of a folded inchworm: its mean speed [mm/s] at each period of its gait [s]."""
WHEELS = (0.9, 0.1, 0.35, 0.5, 0.2, 0.65, 0.42, 0.8, 0.3)
"""Commanded speeds of nine contacts [m/s], an example."""
EFFICIENCY = 0.964
"""Of an inchworm of smart soft composite: step over stroke."""
STIFFNESS, STROKE, WEIGHT = 20.0, 0.1, 1.0
"""Assumed where nothing was published, as in the gallery [N/m, m, N]."""
_COLORS = {"iron": "#007d5c", "rubber": "#2f5fc4", "plastic": "#b8860b", "paper": "#a03060", "glass": "#777777"}


def two_contacts(stiffness: float, stroke: float, friction: dict[str, Any], **more: Any) -> Scene:
    """Build two contacts of WEIGHT, one link, and a triangle wave of a stroke [m] once a second."""
    body = {"contacts": [0.0, 0.2], "links": {"stiffness": stiffness}, "weights": WEIGHT}
    drive = {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[0.0], [stroke], [0.0]]}
    return Scene.model_validate({"name": "two", "body": body, "friction": friction, "drive": drive} | more)


def anchored(rear: tuple[float, float], front: tuple[float, float], load: float = 0.0) -> Scene:
    """Build two contacts whose friction [N] is commanded: one value while they lengthen, one while they shorten."""
    long, short = [rear[0], front[0]], [rear[1], front[1]]
    drive = {
        "times": [0.0, 1.0, 2.0, 3.0, 4.0],
        "period": 4.0,
        "actuation": [[0.0], [STROKE], [STROKE], [0.0], [0.0]],
        "friction": {"isotropic": [long, long, short, short, long]},
    }
    scene = two_contacts(STIFFNESS, STROKE, {"isotropic": 1.0}, drive=drive, loads=load, start="relaxed")
    return Scene.model_validate(scene.document())


def gain(scene: Scene, periods: int = 6) -> float:
    """Return the gain of the last of some periods [m]."""
    return float(_run(scene, periods).per_period[-1])


def _run(scene: Scene, periods: int = 6) -> Trajectory:
    return simulate(scene, periods * scene.drive.period)


def step_of(parameters: np.ndarray, pressure: np.ndarray, friction: np.ndarray) -> np.ndarray:
    """Compute the step max(0, D - 2 mu w/k) with D = c (p - p_0), of parameters c, 2 w/k and p_0."""
    per_pressure, loss, least = parameters
    return np.maximum(0.0, per_pressure * (pressure - least) - loss * friction)


def measured(materials: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return pressures, friction coefficients and mean steps of some grounds, one row after another."""
    pressure = np.tile(PRESSURES, len(materials))
    friction = np.repeat([MATERIALS[name] for name in materials], len(PRESSURES))
    return pressure, friction, np.concatenate([STEPS[name][0] for name in materials])


def fit(materials: tuple[str, ...]) -> np.ndarray:
    """Fit the three parameters of `step_of` to the steps on some grounds."""
    pressure, friction, step = measured(materials)
    starts = ([0.05, 2.0, 0.0], [0.08, 8.0, 40.0], [0.12, 5.0, 80.0])
    found = [least_squares(lambda x: step_of(x, pressure, friction) - step, start) for start in starts]
    return min(found, key=lambda one: one.cost).x


def simulated_steps(parameters: np.ndarray, materials: tuple[str, ...]) -> np.ndarray:
    """Simulate the fitted body, one step per pressure and ground; a unit of the step is taken as 1 mm."""
    per_pressure, loss, least = parameters
    pressure, friction, _ = measured(materials)
    strokes = 1e-3 * per_pressure * (pressure - least)
    scene = two_contacts(2e3 * WEIGHT / loss, 0.1, {"coefficient": {"forward": 0.5, "backward": 9.0}})
    keys = {"drive.actuation[1][0]": strokes, "friction.coefficient.forward": friction}
    return 1e3 * simulate_many(vary(scene, keys, grid=False), duration=6.0).per_period


def explained(step: np.ndarray, told: np.ndarray) -> float:
    """Compute which part of the variance of steps a model explains [%]."""
    return 100.0 * (1.0 - float(((told - step) ** 2).sum()) / float(((step - step.mean()) ** 2).sum()))


def _rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


def summarize_inchworm() -> list[str]:
    """State the fit: its parameters, its error, and how much less a fit without friction explains."""
    fitted = fit(FITTED)
    pressure, friction, step = measured(FITTED)
    told, same = step_of(fitted, pressure, friction), np.full(friction.size, friction.mean())
    starts = ([0.08, 1.0, 40.0], [0.06, 1.0, 80.0])
    blind = min(
        (least_squares(lambda x: step_of(x, pressure, same) - step, one) for one in starts), key=lambda f: f.cost
    )
    parts = (f"{explained(step, one):.0f} %" for one in (told, step_of(blind.x, pressure, same)))
    return [_row(f"{fitted[0]:.4f}", f"{fitted[2]:.1f}", f"{fitted[1]:.2f}", f"{_rms(told - step):.1f}", *parts)]


def compare_inchworm() -> list[str]:
    """Compare the steps of the soft inchworm: fitted on four grounds, predicted on each from the others."""
    fitted, every = fit(FITTED), tuple(MATERIALS)
    model = simulated_steps(fitted, every).reshape(len(every), -1)
    rows = []
    for name, ours in zip(every, model, strict=True):
        step, spread = (np.array(values) for values in STEPS[name])
        others = tuple(other for other in FITTED if other != name)
        told = step_of(fit(others), *measured((name,))[:2])
        mean = np.mean([STEPS[other][0] for other in others], axis=0)
        cells = [f"{a:.1f} ± {b:.1f}" for a, b in zip(step, spread, strict=True)]
        both = " / ".join(" ".join(f"{max(v, 0.0):.1f}" for v in values) for values in (ours, told))
        errors = f"{_rms(told - step):.1f}, {_rms(mean - step):.1f}"
        rows.append(_row(f"{name}, {MATERIALS[name]:g}", *cells, both, errors, f"{EXPONENTS[name]:+.2f}"))
    return rows


def compare_skins() -> list[str]:
    """Predict what the skin of the modular inchworm gains and climbs; only its speed was published."""
    rows = []
    for name, (forward, backward) in SKINS.items():
        scene = two_contacts(500.0, STROKE, {"coefficient": {"forward": forward, "backward": backward}})
        run = _run(scene)
        if not run.unique:
            rows.append(_row(name, f"{forward:g}", f"{backward:g}", "not determined", "0"))
            continue
        climb = math.degrees(steepest_climb(scene).value)
        part = 100.0 * float(run.per_period[-1]) / STROKE
        rows.append(_row(name, f"{forward:g}", f"{backward:g}", f"{part:.1f} %", f"{climb:.1f}°"))
    return rows


def compare_periods() -> list[str]:
    """Predict the steps of a folded inchworm at other periods from that at the longest one: they are the same."""
    told = SPEEDS[max(SPEEDS)] * max(SPEEDS)
    return [
        _row(f"{period:g} s", f"{speed:g} mm/s", f"{speed * period:.1f} mm", f"{told:.1f} mm")
        for period, speed in SPEEDS.items()
    ]


def roll(speeds: tuple[float, ...], pull: float = 0.0) -> tuple[float, float, bool]:
    """Move a hub without friction by contacts whose speeds relative to it are commanded, each on an elastic leg.

    Returns:
        The speed of the hub in the second half of 4 s [m/s], its lag behind this speed [m], and whether it is unique.
    """
    count, duration = len(speeds), 4.0
    links = {"stiffness": STIFFNESS, "between": [[0, i + 1] for i in range(count)]}
    scene = {
        "name": "wheels",
        "body": {"contacts": [0.1 * i for i in range(count + 1)], "links": links},
        "friction": {"isotropic": [0.0] + [0.2] * count},
        "loads": [pull] + [0.0] * count,
        "drive": {"times": [0.0, duration], "actuation": [[0.0] * count, [-duration * v for v in speeds]]},
        "start": "relaxed",
    }
    run = simulate(Scene.model_validate(scene), duration, rate=25.0)
    place = run.displacement[:, 0]
    speed = float(place[-1] - place[50]) / (0.5 * duration)
    return speed, float(place[-1]) - duration * speed, run.unique


def _millimetres(*values: float) -> str:
    return ", ".join(f"{round(1e3 * value, 1) + 0.0:+.1f}" for value in values) + " mm"


def compare_analyses() -> list[str]:
    """Compare with analyses of the same model: each formula, and what a simulation gives."""
    ends, strip = load_scene("two_contacts_anisotropic"), load_scene("continuous_segment")
    front = load_scene("three_contacts_two_ways").document()
    reverse = front | {"drive": front["drive"] | {"actuation": front["drive"]["actuation"][::-1]}}
    reverse["drive"]["times"] = [0.0, 0.25, 0.75, 1.0]

    def backwards(backward: float) -> float:
        return gain(Scene.model_validate(reverse | {"friction": {"forward": 0.2, "backward": backward}}))

    stiff = strip.document() | {"drive": strip.document()["drive"] | {"actuation": [[0.0], [0.2], [0.0]]}}
    stiff["body"] = {"segments": [stiff["body"]["segments"][0] | {"stiffness": 1e4}]}
    rigid = 0.2 * (0.3 - 0.1) / (0.3 + 0.1)
    return [
        _row("[2] friction at both ends", _millimetres(0.1 - 2 * 0.2 / 20), _millimetres(gain(ends))),
        _row("[2] friction along the strip", _millimetres((0.2 - 0.1) * 0.5), _millimetres(gain(strip))),
        _row(
            "[3] the same, very stiff",
            f"{_millimetres(rigid)}, limit of [2]",
            _millimetres(gain(Scene.model_validate(stiff))),
        ),
        _row("[4] against the higher friction, 0.3 over 0.2 N", "backwards", _millimetres(backwards(0.3))),
        _row("[4] the same, 0.5 over 0.2 N", "range not read", _millimetres(backwards(0.5))),
    ]


def compare_claims() -> list[str]:
    """Compare with what abstracts claim."""
    forward, backward = {"forward": 0.2, "backward": 0.5}, {"forward": 0.5, "backward": 0.2}
    gains = [_run(two_contacts(STIFFNESS, STROKE, one)) for one in (forward, backward, {"isotropic": 0.2})]
    breathing = _millimetres(*(run.per_period[-1] for run in gains)) + f"; the last is unique: {gains[2].unique}"
    low, high = 0.1, 0.5
    ways = [gain(anchored(*way)) for way in (((high, low), (low, high)), ((low, high), (high, low)))]
    slope = [gain(anchored(*way, -0.1)) for way in (((high, low), (low, high)), ((low, high), (high, low)))]
    none = _run(two_contacts(STIFFNESS, STROKE, {"isotropic": 0.0}))
    stiff = 2.0 * 0.2 / (STROKE * (1.0 - EFFICIENCY))
    efficient = 100.0 * gain(two_contacts(stiff, STROKE, forward)) / STROKE
    hysteresis = [gain(anchored((swell, shrink), (0.2, 0.2))) for swell, shrink in ((0.3, 0.1), (0.1, 0.1))]
    gel = load_scene("friction_wave_segment").document()
    gels = [gel | {"drive": gel["drive"] | {"wave": gel["drive"]["wave"] | {"amplitude": a}}} for a in (0.3, -0.3)]
    waves = [gain(Scene.model_validate(one), 4) for one in gels]
    slow, fast = (_paced(forward, pace) for pace in (1.0, 0.1))
    pulled = ", ".join(f"{roll(WHEELS, 0.2 * pull)[0]:.2f}" for pull in (0.0, 1.5, 3.5, 5.5))
    scales = [gain(two_contacts(STIFFNESS, STROKE, {"forward": f, "backward": 3 * f})) for f in (0.1, 0.2, 0.4)]
    tripled = gain(two_contacts(STIFFNESS, STROKE, {"forward": 0.2, "backward": 1.8}))
    return [
        _row("[1] breathing", "net motion", breathing),
        _row("[6] no friction", "cannot crawl", f"{_millimetres(none.per_period[-1])}; unique: {none.unique}"),
        _row("[6] friction commanded", "both directions", _millimetres(*ways)),
        _row("[6] the same on a slope, 0.1 N on each foot", "both directions", _millimetres(*slope)),
        _row("[8] step over stroke", f"{100 * EFFICIENCY:.1f} %", f"{efficient:.1f} % at k D/mu = {stiff * 0.5:.1f}"),
        _row("[9] friction hysteresis, and none", "moves with it", _millimetres(*hysteresis)),
        _row("[10] friction highest where long, where short", "opposite ways", _millimetres(*waves)),
        _row("[11] four times the friction, dragged", "faster", _millimetres(*(worm(mu, 1.0) for mu in (0.1, 0.4)))),
        _row("[11] the same, advancing contacts lifted", "faster", _millimetres(*(worm(mu, 0.0) for mu in (0.1, 0.4)))),
        _row("[11] and strokes wrong by 30 %", "faster", _millimetres(*(worm(mu, 0.0, 0.3) for mu in (0.1, 0.4)))),
        _row("[11] tolerance of a stroke", "softness over friction", tolerance()),
        _row("[12] ten times the frequency", "can turn it round", f"the same to {abs(slow - fast):.0e} m"),
        _row("[23] nine wheels, median 0.42 m/s", "the median", f"{roll(WHEELS)[0]:.2f} m/s"),
        _row("[23] ten wheels", "the median", f"unique: {roll((*WHEELS, 0.6))[2]}"),
        _row("[23] nine, pulled by 0, 1.5, 3.5, 5.5 mu", "a force sets the speed", f"{pulled} m/s"),
        _row("[25] forces 1, 2 and 4 times, ratio 3", "ratio does not predict speed", _millimetres(*scales)),
        _row("[25] ratio 3, then 9", "ratio does not predict speed", _millimetres(scales[1], tripled)),
    ]


def _paced(friction: dict[str, float], period: float) -> float:
    """Gain of a period that lasts `period` seconds."""
    drive = {"times": [0.0, period / 2, period], "period": period, "actuation": [[0.0], [STROKE], [0.0]]}
    return gain(two_contacts(STIFFNESS, STROKE, friction, drive=drive))


def worm(mu: float, lifted: float, error: float = 0.0, links: int = 6) -> float:
    """Return the gain of a contraction that runs from tail to head [m].

    The advancing contact keeps the part `lifted` of mu [N]; strokes have random relative errors.
    """
    stroke = 0.03 * (1.0 + error * np.random.default_rng(0).standard_normal(links))
    times, rows, friction = [0.0], [[0.0] * links], [[mu] * (links + 1)]
    for contact in range(links + 1):
        short = [-float(stroke[link]) if link == contact else 0.0 for link in range(links)]
        held = [mu * lifted if i == contact else mu for i in range(links + 1)]
        times += [times[-1] + 1.0, times[-1] + 2.0]
        rows += [rows[-1], short]
        friction += [held, held]
    drive = {
        "times": [*times, times[-1] + 1.0],
        "period": times[-1] + 1.0,
        "actuation": [*rows, rows[0]],
        "friction": {"isotropic": [*friction, friction[0]]},
    }
    body = {"contacts": [0.1 * i for i in range(links + 1)], "links": {"stiffness": STIFFNESS}}
    return gain(Scene.model_validate({"name": "worm", "body": body, "friction": {"isotropic": mu}, "drive": drive}))


def tolerance() -> str:
    """Find the error of a stroke that two of three anchored contacts hold without a slip, by bisection."""
    mu, low, high = 0.3, 0.0, 0.1
    while high - low > 1e-12:
        error = (low + high) / 2
        body = {"contacts": [0.0, 0.2, 0.4], "links": {"stiffness": STIFFNESS}}
        drive = {"times": [0.0, 1.0], "actuation": [[0.0, 0.0], [error, 0.0]]}
        scene = {"name": "three", "body": body, "friction": {"isotropic": mu}, "drive": drive}
        moved = float(np.abs(simulate(Scene.model_validate(scene), 1.0).displacement[-1]).max())
        low, high = (error, high) if moved == 0.0 else (low, error)
    return f"{1e3 * low:.3f} mm, mu/k = {1e3 * mu / STIFFNESS:.3f} mm"


def _row(*cells: str) -> str:
    return "| " + " | ".join(cells) + " |"


def tables() -> list[str]:
    """Return all rows that stand in the page, in order."""
    return [
        *summarize_inchworm(),
        *compare_inchworm(),
        *compare_skins(),
        *compare_periods(),
        *compare_analyses(),
        *compare_claims(),
    ]


def draw_steps(axis: Axes) -> None:
    """Draw measured steps over the pressure, and the fitted model."""
    fitted, fine = fit(FITTED), np.linspace(90.0, 260.0, 400)
    for i, (name, color) in enumerate(_COLORS.items()):
        step, spread = STEPS[name]
        place = np.array(PRESSURES) + 1.5 * (i - 2)
        label = f"{name}, {MATERIALS[name]:g}"
        axis.errorbar(place, step, spread, fmt="o", ms=4, lw=0.8, color=color, capsize=2, label=label)
        told = step_of(fitted, fine, np.full(fine.size, MATERIALS[name]))
        axis.plot(fine, told, color=color, lw=1.0, ls="-" if name in FITTED else ":")
    axis.axhline(0.0, color="#9a9a9a", lw=0.8)
    axis.set(xlabel="pressure [unit of the data]", ylabel="step, velocity / frequency [unit of the data]")
    axis.set_title("a  a soft inchworm on five grounds; lines: fitted model", fontsize=10)
    axis.legend(fontsize=8, frameon=False)
    axis.grid(alpha=0.25)


def draw_exponents(axis: Axes) -> None:
    """Draw the exponents of the step over the frequency; a rate-independent body has 0."""
    for i, (name, color) in enumerate(_COLORS.items()):
        axis.bar(i, EXPONENTS[name], color=color, width=0.6)
    axis.axhline(0.0, color="black", lw=1.0)
    axis.set_xticks(range(len(_COLORS)), list(_COLORS))
    axis.set(ylabel="b of step ~ frequency^b")
    axis.set_title("b  at the largest pressure; the model says 0", fontsize=10)
    axis.grid(alpha=0.25, axis="y")


def main(file: Path = PICTURE) -> None:
    """Print the rows and draw the figure."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    print(*tables(), sep="\n")
    with matplotlib.rc_context({"font.size": 9, "axes.titlesize": 10}):
        figure, axes = plt.subplots(1, 2, figsize=(11.0, 4.2), layout="constrained", width_ratios=(3, 2))
        for axis, draw in zip(axes, (draw_steps, draw_exponents), strict=True):
            draw(axis)
        figure.savefig(file, dpi=100, pil_kwargs={"optimize": True})
        plt.close(figure)
    print(f"written: {file.name}")


if __name__ == "__main__":
    main()
