"""How far masses change the gain: the model against bodies with masses, stepped through time with exact friction.

The judge is the theta method of Moreau and Jean with theta = 1/2, which has no numerical damping: in each step the
velocities at its end minimise a strictly convex function, in which friction is exact. Links have dashpots. MuJoCo, if
it is installed, steps the same bodies in its own way, as a second judge.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np

from crawler_model import Scene, simulate
from crawler_model.run.inertia import BOUND, DAMPED, PREDICTABLE, UNDAMPED, stiffness_at_contacts
from crawler_pictures.style import own_style

BODIES, QUICK = 10, 2
NUMBERS = (0.02, 0.035, 0.06, 0.1, 0.15, 0.2, 0.28, 0.5, 1.0)
"""Inertia numbers at which each body is run."""
COMPARED = (0.06, 0.2)
"""Those at which MuJoCo steps it, too."""
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
    viscous = incidence.T @ (_dashpots(scene, masses, damping)[:, None] * incidence)
    steps = _count_steps(scene, masses)
    at = np.linspace(0.0, 1.0, steps + 1) * drive.period
    times, rows = np.append(drive.times, drive.period), np.vstack((drive.targets, drive.targets[:1]))
    rows = rows[: times.size] if drive.times[-1] < drive.period else rows[:-1]
    times = times[: rows.shape[0]]
    table = np.stack([np.interp(at, times, column) for column in rows.T], axis=1)
    force = (table[:, : body.springs] * body.stiffness) @ incidence
    bounds = table[:, body.springs : body.springs + 2 * body.contacts]
    x = np.array(scene.start_displacement)
    return _step(x, masses, stiffness, viscous, force, bounds, drive.period / steps, body.share, periods)


def _dashpots(scene: Scene, masses: np.ndarray, damping: float) -> np.ndarray:
    """Compute the viscosity of each link for a ratio of damping, shape (S,) [N s/m]."""
    return np.asarray(2.0 * damping * np.sqrt(scene.body.stiffness * masses[scene.body.ends].mean(axis=1)))


def _count_steps(scene: Scene, masses: np.ndarray) -> int:
    """Count the steps of a period that follow the fastest oscillation."""
    assert scene.drive.period is not None
    fastest = float(np.sqrt((stiffness_at_contacts(scene.body) * 2.0 / masses).max()))
    return max(int(np.ceil(scene.drive.period * fastest / _PHASE)), 2000)


def step_in_mujoco(scene: Scene, masses: np.ndarray, damping: float, periods: int = _PERIODS) -> np.ndarray:
    """Step the same body in MuJoCo: slide joints with friction loss, tendons with stiffness and damping between them.

    Friction that differs forward and backward is its mean, which MuJoCo knows, and a constant force of half of the
    difference. Friction is as hard as steps allow.

    Args:
        scene: the body and its drive, with constant friction.
        masses: of each contact, shape (N,) [kg].
        damping: of each link, relative to the critical damping of its ends.
        periods: number of periods.

    Returns:
        y gained in each period, shape (periods,) [m].
    """
    import mujoco

    body, drive = scene.body, scene.drive
    assert drive.period is not None
    steps = _count_steps(scene, masses)
    h, forward, backward = drive.period / steps, drive.forward[0], drive.backward[0]
    joint = f'type="slide" axis="1 0 0" solreffriction="{2.0 * h!r} 1" solimpfriction="0.9999 0.9999 0.001 0.5 2"'
    contacts = "".join(
        f'<body><joint name="c{i}" {joint} frictionloss="{loss!r}"/>'
        f'<geom size="0.01" mass="{mass!r}" contype="0" conaffinity="0"/></body>'
        for i, (loss, mass) in enumerate(zip((0.5 * (forward + backward)).tolist(), masses.tolist(), strict=True))
    )
    springs = zip(body.stiffness.tolist(), _dashpots(scene, masses, damping).tolist(), body.ends.tolist(), strict=True)
    tendons = "".join(
        f'<fixed stiffness="{k!r}" damping="{c!r}" springlength="1"><joint joint="c{a}" coef="-1"/>'
        f'<joint joint="c{b}" coef="1"/></fixed>'
        for k, c, (a, b) in springs
    )
    model: Any = mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 0" timestep="{h!r}" integrator="implicitfast" iterations="50" '
        'tolerance="1e-12" noslip_iterations="20" noslip_tolerance="1e-12"/>'
        '<compiler boundmass="1e-15" boundinertia="1e-15"/>'
        f"<worldbody>{contacts}</worldbody><tendon>{tendons}</tendon></mujoco>"
    )
    data: Any = mujoco.MjData(model)
    apart = 1000.0 * np.arange(body.contacts)  # makes rest lengths positive, as tendons require
    data.qpos[:], data.qfrc_applied[:] = scene.start_displacement + apart, 0.5 * (backward - forward)
    ends = np.rint(np.arange(1, steps + 1) * (1e9 * h)).astype(np.int64)
    lengths = drive.sample(ends)[:, : body.springs] + np.diff(apart[body.ends], axis=1)[:, 0]
    rows, gains = np.repeat(lengths[:, :, None], 2, axis=2), np.zeros(periods)
    for period in range(periods):
        before = np.array(data.qpos)
        for row in rows:
            model.tendon_lengthspring[:] = row
            mujoco.mj_step(model, data)
        gains[period] = body.share @ (data.qpos - before)
    return gains


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
        periods, its ratio to the number, and the deviation in MuJoCo, None where it was not run; then a row for each
        ratio of damping, of all bodies up to the largest predictable number: median, 95 % quantile and maximum of the
        size of these ratios, how many runs deviate by more than is announced, and by how much MuJoCo differs at most.
    """
    rows: list[dict[str, Any]] = []
    peer = importlib.util.find_spec("mujoco") is not None
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
                steppers = [step_with_masses, *([step_in_mujoco] if peer and number in COMPARED else [])]
                found = [step(heavy, masses, damping)[_PERIODS // 2 :].mean() for step in steppers]
                row = {"case": scene.name, "n": scene.body.contacts, "number": number, "damping": damping}
                deviation, *others = [float(one) / gain - 1.0 for one in found]
                row |= {"gain": gain, "deviation": deviation, "ratio": abs(deviation) / number}
                rows.append(row | {"mujoco": others[0] if others else None})
        progress((done + 1) / len(scenes))
    return rows + [_summarise(rows, damping) for damping in DAMPING]


def _summarise(rows: list[dict[str, Any]], damping: float) -> dict[str, Any]:
    some = [row for row in rows if row["damping"] == damping and row["number"] <= PREDICTABLE]
    ratios = np.array([row["ratio"] for row in some])
    median, high = (float(np.quantile(ratios, q)) for q in (0.5, 0.95))
    beyond = int((ratios > BOUND).sum())
    facts = {"median": median, "quantile_95": high, "most": float(ratios.max()), "runs": len(some), "beyond": beyond}
    apart = [abs(row["mujoco"] - row["deviation"]) for row in some if row["mujoco"] is not None]
    return {"case": "all bodies", "damping": damping} | facts | {"mujoco": max(apart, default=None)}


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
