"""How far masses change the gain: the model against bodies with masses, stepped through time with exact friction.

The judge is the theta method of Moreau and Jean with theta = 1/2, which has no numerical damping: in each step the
velocities at its end minimise a strictly convex function, in which friction is exact. Links have dashpots.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np

from crawler_model import Scene, simulate
from crawler_model.run.inertia import BOUND, DAMPED, PREDICTABLE, UNDAMPED
from crawler_pictures.style import own_style

BODIES, QUICK = 10, 2
NUMBERS = (0.02, 0.035, 0.06, 0.1, 0.15, 0.2, 0.28, 0.5, 1.0)
"""Inertia numbers at which each body is run."""
DAMPING = (0.05, 0.5)
"""Ratios of damping: lightly and well damped."""
_PERIODS = 6
_PHASE = 0.02
"""Phase of the fastest oscillation in a step [rad]."""
_TWO = {"times": [0, 0.5, 1.0], "period": 1.0, "actuation": [[0.0], [0.1], [0.0]]}
_WORM = {
    "times": [0, 0.25, 0.5, 0.75, 1.0],
    "period": 1.0,
    "actuation": [[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1], [0, 0]],
}


def _chain(name: str, gaps: Any, stiffness: Any, friction: Any, drive: Any, masses: Any = 1.0) -> Scene:
    contacts = np.append(0.0, np.cumsum(gaps)).tolist()
    forward, backward = friction
    body = {"contacts": contacts, "links": {"stiffness": stiffness}, "masses": masses}
    friction = {"forward": forward, "backward": backward}
    parts = {"name": name, "body": body, "friction": friction, "start": "relaxed", "drive": drive}
    return Scene.model_validate(parts)


def build_bodies(count: int) -> list[Scene]:
    """Build bodies with masses of about 1 kg, whose scale is chosen later, and drives of a period of 1 s.

    None is critical: where friction does not determine the translation, masses do, however small.

    Args:
        count: their number; after the fifth one they are random chains.

    Returns:
        The scenes.
    """
    wave = np.linspace(0.0, 1.0, 33)
    sines = 0.04 * (1.0 - np.cos(2.0 * np.pi * (wave[:, None] - np.array([0.0, 0.2, 0.4, 0.6]))))
    sines[-1] = sines[0]
    strip = {"name": "strip", "from": 0.0, "to": 0.4, "stiffness": 4.0, "elements": 12}
    scenes = [
        _chain("two contacts", [0.2], 20.0, (0.1, 0.3), _TWO),
        _chain("three contacts", [0.2, 0.2], 20.0, (0.1, 0.3), _WORM),
        _chain("heavy middle", [0.2, 0.2], [20.0, 40.0], ([0.1, 0.2, 0.1], [0.35, 0.8, 0.35]), _WORM, [1.0, 3.0, 1.0]),
        _chain(
            "wave", [0.2] * 4, 30.0, (0.1, 0.35), {"times": wave.tolist(), "period": 1.0, "actuation": sines.tolist()}
        ),
        Scene.model_validate(
            {
                "name": "segment",
                "body": {"segments": [strip | {"friction": {"forward": 0.5, "backward": 1.3}}], "masses": 1.0},
                "drive": _TWO | {"actuation": [[0.0], [0.4], [0.0]]},
            }
        ),
    ]
    seed = 0
    while len(scenes) < count:
        rng, seed = np.random.default_rng(seed), seed + 1
        n, rows = int(rng.integers(2, 6)), int(rng.integers(2, 6))
        forward = rng.uniform(0.05, 0.2, n)
        times = np.append(0.0, np.sort(rng.uniform(0.1, 0.9, rows)))
        lengths = rng.uniform(0.0, 0.1, (rows + 1, n - 1))
        drive = {"times": [*times.tolist(), 1.0], "period": 1.0, "actuation": [*lengths.tolist(), lengths[0].tolist()]}
        friction = forward.tolist(), (forward * rng.uniform(2.0, 4.0, n)).tolist()
        stiffness, masses = rng.uniform(15.0, 60.0, n - 1).tolist(), rng.uniform(0.5, 2.0, n).tolist()
        scene = _chain(f"random {seed}", [0.2] * (n - 1), stiffness, friction, drive, masses)
        gain = simulate(scene).per_period[-1]
        if gain > 0.02 and np.diff(times, append=1.0).min() > 0.08:
            scenes.append(scene)
    return scenes[:count]


def step_with_masses(scene: Scene, masses: np.ndarray, damping: float, periods: int = _PERIODS) -> np.ndarray:
    """Step a body on a line with masses through periods of its drive.

    Args:
        scene: the body and its drive.
        masses: of each contact, shape (N,) [kg].
        damping: of each link, relative to the critical damping of its ends.
        periods: number of periods.

    Returns:
        y gained in each period, shape (periods,) [m].
    """
    body, drive = scene.body, scene.drive
    assert drive.period is not None
    a, b = body.ends.T
    incidence = np.zeros((body.springs, body.contacts))
    incidence[np.arange(body.springs), a], incidence[np.arange(body.springs), b] = -1.0, 1.0
    stiffness = incidence.T @ (body.stiffness[:, None] * incidence)
    dashpot = 2.0 * damping * np.sqrt(body.stiffness * 0.5 * (masses[a] + masses[b]))
    viscous = incidence.T @ (dashpot[:, None] * incidence)
    fastest = float(np.sqrt((np.diag(stiffness) * 2.0 / masses).max()))
    steps = max(int(np.ceil(drive.period * fastest / _PHASE)), 2000)
    at = np.linspace(0.0, 1.0, steps + 1) * drive.period
    times, rows = np.append(drive.times, drive.period), np.vstack((drive.targets, drive.targets[:1]))
    rows = rows[: times.size] if drive.times[-1] < drive.period else rows[:-1]
    times = times[: rows.shape[0]]
    table = np.stack([np.interp(at, times, column) for column in rows.T], axis=1)
    force = (table[:, : body.springs] * body.stiffness) @ incidence
    bounds = table[:, body.springs : body.springs + 2 * body.contacts]
    x = np.array(scene.start_displacement)
    return _step(x, masses, stiffness, viscous, force, bounds, drive.period / steps, body.share, periods)


@numba.njit(cache=False)
def _step(x, masses, stiffness, viscous, force, bounds, h, share, periods):  # type: ignore[no-untyped-def]
    n = x.size
    matrix = 0.5 * h * viscous + 0.25 * h * h * stiffness
    for i in range(n):
        matrix[i, i] += masses[i]
    v, old, right, gains = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(periods)
    for period in range(periods):
        before = x.copy()
        for k in range(force.shape[0] - 1):
            for i in range(n):
                old[i] = v[i]
                total = 0.5 * (force[k, i] + force[k + 1, i])
                for j in range(n):
                    total -= stiffness[i, j] * (x[j] + 0.25 * h * v[j]) + 0.5 * viscous[i, j] * v[j]
                right[i] = masses[i] * v[i] + h * total
            for _ in range(200):  # Gauss and Seidel; the masses make the matrix dominant
                change = 0.0
                for i in range(n):
                    rest = right[i]
                    for j in range(n):
                        if j != i:
                            rest -= matrix[i, j] * v[j]
                    up, down = h * bounds[k + 1, i], h * bounds[k + 1, n + i]
                    new = 0.0
                    if rest > up:
                        new = (rest - up) / matrix[i, i]
                    elif rest < -down:
                        new = (rest + down) / matrix[i, i]
                    change = max(change, abs(new - v[i]))
                    v[i] = new
                if change < 1e-13:
                    break
            for i in range(n):
                x[i] += 0.5 * h * (old[i] + v[i])
        for i in range(n):
            gains[period] += share[i] * (x[i] - before[i])
    return gains


def with_masses(scene: Scene, factor: float) -> Scene:
    """Multiply the masses of a scene.

    Args:
        scene: the scene.
        factor: of its masses [1].

    Returns:
        The scene with these masses.
    """
    document = scene.document()
    document["body"]["masses"] = (factor * np.array(document["body"]["masses"])).tolist()
    return Scene.model_validate(document)


def measure_inertia(bodies: int, progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """Measure how far masses change the gain, at given inertia numbers.

    Returns:
        A row for each body, inertia number and ratio of damping: the relative deviation of the mean gain of the last
        periods, and its ratio to the number; then a row for each ratio of damping, of all bodies up to the largest
        predictable number: median, 95 % quantile and maximum of the size of these ratios, and how many runs deviate by
        more than is announced.
    """
    rows: list[dict[str, Any]] = []
    scenes = build_bodies(bodies)
    for done, scene in enumerate(scenes):
        run = simulate(scene)
        assert run.inertia is not None
        gain = float(run.per_period[-1])
        for number in NUMBERS:
            heavy = with_masses(scene, (number / run.inertia.number) ** 2)
            masses = heavy.ground.masses
            assert masses is not None
            for damping in DAMPING:
                found = float(step_with_masses(heavy, masses, damping)[_PERIODS // 2 :].mean())
                row = {"case": scene.name, "n": scene.body.contacts, "number": number, "damping": damping}
                deviation = found / gain - 1.0
                rows.append(row | {"gain": gain, "deviation": deviation, "ratio": abs(deviation) / number})
        progress((done + 1) / len(scenes))
    return rows + [_summarise(rows, damping) for damping in DAMPING]


def _summarise(rows: list[dict[str, Any]], damping: float) -> dict[str, Any]:
    some = [row for row in rows if row["damping"] == damping and row["number"] <= PREDICTABLE]
    ratios = np.array([row["ratio"] for row in some])
    median, high = (float(np.quantile(ratios, q)) for q in (0.5, 0.95))
    beyond = int((ratios > BOUND).sum())
    facts = {"median": median, "quantile_95": high, "most": float(ratios.max()), "runs": len(some), "beyond": beyond}
    return {"case": "all bodies", "damping": damping} | facts


@own_style()
def draw_inertia(rows: list[dict[str, Any]], file: Path) -> None:
    """Draw the deviation of the gain against the inertia number.

    Args:
        rows: from `measure_inertia`.
        file: the .png file.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 5.0), dpi=110, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, 2, sharey=True)
    names = list(dict.fromkeys(row["case"] for row in rows if "number" in row))
    for axes, damping, slope in zip(panels, DAMPING, (UNDAMPED, DAMPED), strict=True):
        for k, name in enumerate(names):
            some = [row for row in rows if row["case"] == name and row["damping"] == damping]
            sizes = [max(100.0 * abs(row["deviation"]), 1e-3) for row in some]
            axes.plot([row["number"] for row in some], sizes, "o-", ms=4, lw=0.8, color=f"C{k}", label=name)
        line = np.array([min(NUMBERS), PREDICTABLE])
        axes.plot(line, 100.0 * slope * line, "k", lw=2, label=f"r/{1 / slope:g}, typical")
        axes.plot(line, 100.0 * BOUND * line, "k--", lw=1.5, label=f"{BOUND:g} r, bound")
        axes.axvspan(PREDICTABLE, max(NUMBERS), color="0.9", zorder=0)
        axes.set(xscale="log", yscale="log", xlabel="inertia number r", ylim=(0.01, 1000.0))
        axes.set_title(f"damping ratio {damping:g}", fontsize=10)
        axes.grid(True, which="major", color="0.85", lw=0.5)
    panels[0].set_ylabel("deviation of the gain [%]")
    panels[0].text(0.32, 0.014, "not to be predicted", fontsize=8)
    for axes in panels:
        axes.legend(fontsize=7, loc="upper left", ncols=2)
    figure.savefig(file)
