"""Make the record of docs/laboratory.md: a made-up robot, seen by a made-up camera. Nothing here was measured.

`python examples/laboratory/make_record.py [FOLDER]` writes camera.csv and motors.csv, always the same ones.
Look for: LAG, SCALE and STUCK, which `crawler identify` finds again from the two tables and robot.yaml.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from crawler_model import Scene, load_scene, simulate

HERE = Path(__file__).parent
PERIOD, CYCLES, WAYPOINTS = 2.0, 12, 8  # s
STROKE = 0.025  # m, to both sides; each link follows the one before it by a quarter of a period
STUCK = 16.0  # s; from then on link 0 keeps its length
FRAMES, MOTORS = 30, 20  # rows per second of the two tables
LAG, SCALE = 0.043, 0.003  # s, 1
PIXEL, TRACKER, MEMORY, DRIFT = 4e-4, 2e-4, 0.6, 5e-4  # m; MEMORY: of the tracker's filter from frame to frame
DROPPED, LOST, HIDDEN = 0.03, 0.02, (2, 9.2, 9.9)  # frames, markers; one marker is hidden between two times, s
FINE = 3000  # samples per second; a whole number of them is a frame, and the lag


def command() -> tuple[np.ndarray, np.ndarray]:
    """Return the times of the waypoints and the lengths that the motors are told, shape (K, 3) [m]."""
    turn = 2.0 * np.pi * np.arange(CYCLES * WAYPOINTS + 1)[:, None] / WAYPOINTS
    phase = -0.5 * np.pi * np.arange(3)
    return turn[:, 0] / (2.0 * np.pi) * PERIOD, np.round(STROKE * (np.sin(turn + phase) - np.sin(phase)), 5)


def see(position: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return what the camera writes about positions at its frames, shape (T, 4) [m]; NaN where a marker is lost."""
    rows, contacts = position.shape
    noise = rng.normal(0.0, TRACKER, position.shape)
    for k in range(1, rows):
        noise[k] = MEMORY * noise[k - 1] + np.sqrt(1.0 - MEMORY**2) * noise[k]
    drift = np.linspace(-0.5, 0.5, rows)[:, None] * rng.normal(0.0, DRIFT, contacts)
    seen = PIXEL * np.rint(((1.0 + SCALE) * position + 0.12 + drift + noise) / PIXEL)
    seen[rng.random(position.shape) < LOST] = np.nan
    marker, first, last = HIDDEN
    seen[round(first * FRAMES) : round(last * FRAMES), marker] = np.nan
    return seen


def write(path: Path, header: str, time: np.ndarray, values: np.ndarray, digits: int) -> None:
    """Write a table in seconds and millimetres."""
    lines = ["# made up by examples/laboratory/make_record.py, not measured", header]
    for t, row in zip(time, values, strict=True):
        lines.append(",".join((f"{t:.3f}", *("" if np.isnan(v) else f"{1e3 * v + 0.0:.{digits}f}" for v in row))))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def main(folder: Path) -> None:
    """Write both tables."""
    times, told = command()
    moved = told.copy()
    moved[times >= STUCK, 0] = told[times == STUCK, 0]
    drive = {"times": times.tolist(), "actuation": moved.tolist()}
    run = simulate(Scene.model_validate(load_scene(HERE / "truth.yaml").document() | {"drive": drive}), times[-1], FINE)
    frame = np.arange(round(times[-1] * FRAMES) + 1)
    late = np.maximum(frame * FINE // FRAMES - round(LAG * FINE), 0)
    rng = np.random.default_rng(1)
    seen = see(run.scene.body.position + run.displacement[late], rng)
    kept = rng.random(frame.size) >= DROPPED
    write(folder / "camera.csv", "t_s,tail_mm,rear_mm,front_mm,head_mm", frame[kept] / FRAMES, seen[kept], 1)
    clock = np.arange(round(times[-1] * MOTORS) + 1) / MOTORS
    told = np.column_stack([np.interp(clock, times, column) for column in told.T])
    write(folder / "motors.csv", "t_s,motor_1_mm,motor_2_mm,motor_3_mm", clock, told, 3)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
