"""Compare the model with files that others have published: the numbers of validation.md that need them.

    python docs/validation_data.py GECKO_MODEL GECKO_ROBOT LOOP.csv

GECKO_MODEL and GECKO_ROBOT are clones of the repositories of source [22], LOOP.csv is the record of source [26].
Nothing of them is kept here.
"""

from __future__ import annotations

import argparse
import ast
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from crawler_lab.springs.springs import fit_springs
from crawler_model import Scene, simulate

MODEL, ROBOT = "982cfe2", "cdce253"
"""Commits of the two repositories; the second one contains the pressures of the experiment."""
STEPS, STEERING = (50, 60, 70, 80, 90), (-0.5, -0.3, -0.1, 0.1, 0.3, 0.5)
"""q1 [degrees] and q2 of the 30 gaits."""
LEG, TORSO = 0.091, 0.103
ARCS = np.array([LEG, LEG, TORSO, LEG, LEG])
"""Lengths of the actuators: legs front left, front right, torso, rear left, rear right [m]."""
SIDE = np.array([-1.0, 1.0, 1.0, 1.0, -1.0])
"""Signs of the joints for positive bending angles of the actuators."""
MEAN = np.array([45.0, 45.0, 0.0, 45.0, 45.0])
"""Bending angles of the reference shape [degrees]."""
LINKS = [[0, 2], [2, 1], [0, 3], [3, 7], [0, 4], [4, 8], [1, 5], [5, 9], [1, 6], [6, 10]]
JOINTS = [[0, 3, 7], [0, 4, 8], [0, 2, 1], [1, 5, 9], [1, 6, 10], [3, 0, 4], [3, 0, 2], [2, 1, 5], [5, 1, 6]]
"""Of the points front and rear of the torso, its joint, the joints of the legs, the feet; the last joints are stiff."""
OF_LINK = [2, 2, 0, 0, 1, 1, 3, 3, 4, 4]
FEET = ((0, 1, 1, 0), (1, 0, 0, 1))
"""Which feet hold while the torso bends to the left, and to the right."""
BENDING, HOLD = 0.1, 10.0
"""Stiffness of the actuators [N m/rad] and friction of a foot that holds [N]: only drag * LEG / BENDING matters."""
DRAGS = (0.02, 0.1, 0.2, 0.3, 0.4, 0.5)
"""Friction of a foot that swings, in units of BENDING / LEG; the first one is none."""


def read(clone: Path, commit: str, path: str) -> str:
    """Read a file of a clone at a commit."""
    done = subprocess.run(["git", "-C", clone, "show", f"{commit}:{path}"], capture_output=True, text=True, check=True)
    return done.stdout


def find_constant(text: str, name: str) -> Any:
    """Find the value that a Python file assigns to a name; of an array, the list."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id == name:
            return ast.literal_eval(node.value.args[0] if isinstance(node.value, ast.Call) else node.value)
    raise ValueError(f"no {name} in the file")


def find_angles(pressures: list[float], calibration: dict[int, list[float]]) -> np.ndarray:
    """Find the bending angles at which the calibration has six pressures [degrees]."""
    grid, found = np.linspace(0.0, 150.0, 3001), []
    for channel, pressure in enumerate(pressures):
        rising = np.maximum.accumulate(np.polyval(calibration[channel], grid)) + 1e-9 * grid
        found.append(float(np.interp(pressure, rising, grid)) if pressure > 0.005 else 0.0)
    return np.maximum([*found[:2], found[2] - found[3], *found[4:]], [1e-3, 1e-3, -180.0, 1e-3, 1e-3])


def half_tangents(angles: np.ndarray) -> np.ndarray:
    """Compute the distance from the ends of arcs to where their tangents meet, shape (5,) [m]."""
    bent = np.radians(np.where(np.abs(angles) < 1e-6, 1e-6, angles))
    return ARCS / bent * np.tan(bent / 2.0)


def build_points() -> np.ndarray:
    """Build the reference shape, its head to +y: two tangents for each arc, shape (11, 2) [m]."""
    t = half_tangents(MEAN)
    ends = [(0.0, 180.0, -1), (0.0, 0.0, 1), (-2.0 * t[2], 180.0, 1), (-2.0 * t[2], 0.0, -1)]
    hinges, feet = [], []
    for (height, angle, turn), length, bend in zip(ends, t[[0, 1, 3, 4]], MEAN[[0, 1, 3, 4]], strict=True):
        first, second = np.radians([angle, angle + turn * bend])
        hinges.append(np.array([0.0, height]) + length * np.array([np.cos(first), np.sin(first)]))
        feet.append(hinges[-1] + length * np.array([np.cos(second), np.sin(second)]))
    return np.array([[0.0, 0.0], [0.0, -2.0 * t[2]], [0.0, -t[2]], *hinges, *feet])


def build_gecko(right: np.ndarray, left: np.ndarray, drag: float) -> Scene:
    """Build the robot and a cycle from the angles where its torso is bent to the right to the left and back."""

    def row(angles: np.ndarray) -> list[float]:
        lengths = (half_tangents(angles) - half_tangents(MEAN))[OF_LINK]
        return [*lengths.tolist(), *(SIDE * np.radians(angles - MEAN)).tolist(), 0.0, 0.0, 0.0, 0.0]

    def friction(holds: tuple[int, ...]) -> list[float]:
        return [0.0] * 7 + [HOLD if one else drag * BENDING / LEG for one in holds]

    times, rows, held = [0.0], [row(right)], [friction((1, 1, 1, 1))]
    for start, end, holds in ((right, left, FEET[0]), (left, right, FEET[1])):
        for step in range(4):  # the commanded lengths are no straight lines in the angles
            times.append(times[-1] + 1.0)
            rows.append(row(start + (end - start) * step / 3.0 if step < 3 else end))
            held.append(friction(holds))
        times.append(times[-1] + 1.0)
        rows.append(rows[-1])
        held.append(friction((1, 1, 1, 1)))
    sides = ("forward", "backward", "left", "right")
    joints = {"stiffness": [BENDING] * 5 + [200.0 * BENDING] * 4, "between": JOINTS}
    links = {"stiffness": 2000.0, "between": LINKS}
    scene = {
        "name": "gecko",
        "dimension": 2,
        "body": {"points": build_points().tolist(), "springs": "length", "links": links, "joints": joints},
        "friction": dict.fromkeys(sides, held[0]),
        "heading": [1, 0],
        "start": "relaxed",
        "drive": {"times": times, "period": times[-1], "actuation": rows, "friction": dict.fromkeys(sides, held)},
    }
    return Scene.model_validate(scene)


def travel(scene: Scene) -> np.ndarray:
    """Compute what the third cycle turns [degrees] and moves the front of the torso ahead and to the left [cm]."""
    run = simulate(scene, 3.0 * float(scene.drive.period or 0.0), 1.0)
    begin = -1 - round(scene.drive.period or 0.0)
    (front, rear), now = run.position[begin, :2], run.position[-1, 0]
    ahead = (front - rear) / np.linalg.norm(front - rear)
    moved = 100.0 * (now - front)
    turned = np.degrees(run.yaw[-1] - run.yaw[begin])
    return np.array([turned, moved @ ahead, ahead[0] * moved[1] - ahead[1] * moved[0]])


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def compare_gecko(model: Path, robot: Path) -> list[str]:
    """Predict the measured turn and travel of 30 gaits from their pressures, with and without a fitted drag."""
    comparison = read(model, MODEL, "Scripts/finding_gait_law/analytic_model_10_compare_to_exp_c110redo.py")
    turned = np.array(find_constant(comparison, "DEPS_EXP"))
    planner = read(model, MODEL, "Src/TrajectoryPlanner/optimal_planner.py")
    a, b = np.meshgrid(STEPS, STEERING)
    terms = np.array([np.ones(a.shape), a, b, a**2, b**2, a * b])
    measured = np.stack([turned, *(np.tensordot(find_constant(planner, name), terms, 1) for name in ("cx", "cy"))])
    calibration = find_constant(read(robot, ROBOT, "Code/Src/Controller/calibration.py"), "clb")["vS11"]

    def predict(q1: int, q2: float, drag: float) -> np.ndarray:
        name = f"Code/Patterns/vS11/q1_{q1}q2_{str(q2).replace('.', '')}.csv"
        rows = [line.split(",")[:6] for line in read(robot, ROBOT, name).splitlines()]
        right, left = (find_angles([float(cell) for cell in rows[k]], calibration) for k in (0, 3))
        return travel(build_gecko(right, left, drag))

    lines, half = [f"measured: rms {', '.join(f'{_rms(one):.3g}' for one in measured)}"], np.indices(a.shape).sum(0) % 2
    for drag in DRAGS:
        told = np.array([[predict(q1, q2, drag) for q1 in STEPS] for q2 in STEERING]).transpose(2, 0, 1)
        error, right = told - measured, int((np.sign(told[0]) == np.sign(turned)).sum())
        errors = ", ".join(f"{_rms(one):.3g}" for one in (*error, *(error[0][half == k] for k in (0, 1))))
        alike = float(np.corrcoef(told[0].ravel(), turned.ravel())[0, 1])
        scale = float(np.sum(told[0] * turned) / np.sum(told[0] ** 2))
        lines.append(
            f"drag {drag}: rms of turn, ahead, aside, turn of either half {errors}; {right} of 30 turn the right way; "
            f"correlation {alike:.3f}; measured over predicted turn {scale:.2f}"
        )
    return lines


def compare_loop(table: Path) -> list[str]:
    """Fit springs with a memory to a loop in mm and N, and state what they explain."""
    elongation, force, time = np.loadtxt(table, delimiter=",").T
    found = fit_springs(table.name, 1e-3 * elongation, force, time)
    part = 100.0 * (1.0 - found.residual**2 / np.var(force))
    return [
        f"loop: residual {found.residual:.3g} N, {100 * found.residual / found.width:.2g} % of the width; "
        f"{part:.1f} % of the variance explained by {len(found.elements)} elements"
    ]


def main() -> None:
    """Print all numbers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("gecko_model", "gecko_robot", "loop"):
        parser.add_argument(name, type=Path)
    given = parser.parse_args()
    print(*compare_loop(given.loop), sep="\n", flush=True)
    print(*compare_gecko(given.gecko_model, given.gecko_robot), sep="\n")


if __name__ == "__main__":
    main()
