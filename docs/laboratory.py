"""Run the blocks of docs/laboratory.md and draw its figure, pictures/laboratory.png, from the files that they leave."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crawler_model import load_scene, simulate

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PAGE = Path(__file__).with_suffix(".md")
PICTURE = PAGE.parent / "pictures" / "laboratory.png"
FINE = 1000.0
"""Samples of the model per second, between which positions are taken to be straight."""
FAILS = 16.0
"""When the motor stops [s]."""
_COLORS = ("#007d5c", "#2f5fc4", "#b8860b", "#a03060")
_GREY = "#777777"


def walk(folder: Path) -> dict[str, Any]:
    """Run the page's blocks one after another.

    Args:
        folder: where they run, and leave their files.

    Returns:
        The names that the Python blocks define.
    """
    text, names = PAGE.read_text(encoding="utf-8"), {"__name__": "laboratory"}
    paths = {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    os.chdir(folder)
    for block in re.finditer(r"^```(python|bash)\n(.*?)^```$", text, re.S | re.M):
        if block[1] == "python":
            line = text.count("\n", 0, block.start(2))  # errors name the page's own lines
            exec(compile("\n" * line + block[2], str(PAGE), "exec"), names)
        else:
            subprocess.run(["bash", "-ec", block[2]], check=True, env=os.environ | paths)
    return names


def see(found: dict[str, Any], time: np.ndarray) -> np.ndarray:
    """Compute what the camera would show of the robot that was found, with working motors.

    Args:
        found: what `crawler identify --json` printed, apart from found.yaml.
        time: of the frames, shape (T,) [s].

    Returns:
        Positions, shape (T, 4) [mm].
    """
    run = simulate(load_scene("found.yaml"), time[-1], FINE)
    position = run.scene.body.position + run.displacement
    sensor = {one["name"]: one["value"] for one in found["sensors"]}
    late = np.stack([np.interp(time - sensor["lag"], run.time, column) for column in position.T], axis=1)
    record = found["recordings"][0]
    offset, drift = (np.array(list(record[key].values())) for key in ("offset", "drift"))
    fitted = np.genfromtxt("before.csv", delimiter=",", skip_header=2)[:, 0]
    part = (time - 0.5 * (fitted[0] + fitted[-1])) / (fitted[-1] - fitted[0])
    return np.asarray(1e3 * ((1.0 + sensor["scale"]) * late + offset + drift * part[:, None]))


def draw_record(axis: Axes, below: Axes, camera: np.ndarray, model: np.ndarray) -> None:
    """Draw what the camera showed and what it would show of the model, and their difference."""
    time = camera[:, 0]
    for contact, color in enumerate(_COLORS):
        axis.plot(time, camera[:, 1 + contact], ".", color=color, ms=2.5)
        axis.plot(time, model[:, contact], color=color, lw=0.9, label=f"contact {contact}")
        below.plot(time, camera[:, 1 + contact] - model[:, contact], ".", color=color, ms=2.0)
    for one in (axis, below):
        one.axvspan(15.0, time[-1], color="0.93", zorder=0)
        one.axvline(FAILS, color=_GREY, lw=0.8, ls=":")
        one.set_xlim(time[0], time[-1])
    axis.set(ylabel="position [mm]", title="a  dots: camera, lines: model; grey: removed before the fit")
    axis.legend(loc="upper left", fontsize=8, frameon=False, ncols=2)
    below.set(xlabel="time [s]", ylabel="camera - model [mm]", ylim=(-3.0, 3.0))


def draw_speeds(axis: Axes, names: dict[str, Any]) -> None:
    """Draw the speed with each gait: as recorded, as predicted with its band, and on the true robot."""
    axis.bar(0, names["recorded"], 0.55, color="#c9d6df")
    for place, (name, period) in enumerate({"other": 2.0, "best": 1.0}.items(), start=1):
        gain = json.loads(Path(f"{name}.json").read_text())["gain"]
        band = {key: 1e3 * gain[key] / period for key in ("value", "low", "high")}
        axis.bar(place, band["value"], 0.55, color="#c9d6df")
        ends = [[band["value"] - band["low"]], [band["high"] - band["value"]]]
        axis.errorbar(
            [place],
            [band["value"]],
            yerr=ends,
            color="black",
            capsize=9,
            lw=1.2,
            label="predicted, 95 %" if place == 1 else None,
        )
        axis.plot(
            place,
            names["speeds"][name],
            "o",
            color=_COLORS[3],
            ms=4,
            label="on the true robot" if place == 1 else None,
        )
    axis.set_xticks(range(3), ["recorded", "other.yaml", "best.yaml"])
    axis.set(ylabel="speed [mm/s]", title="b  three gaits", ylim=(0.0, 23.0))
    axis.legend(loc="upper left", fontsize=8, frameon=False)


def main() -> None:
    """Draw the figure."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    with tempfile.TemporaryDirectory() as folder:
        names = walk(Path(folder))
        model = see(names["found"], names["time"])
        style: dict[Any, Any] = {"font.size": 9, "axes.titlesize": 10}
        with matplotlib.rc_context(style):
            figure = plt.figure(figsize=(11.0, 5.2), layout="constrained")
            grid = figure.add_gridspec(2, 2, width_ratios=(2.2, 1.0), height_ratios=(2.2, 1.0))
            above = figure.add_subplot(grid[0, 0])
            draw_record(above, figure.add_subplot(grid[1, 0]), names["camera"], model)
            draw_speeds(figure.add_subplot(grid[:, 1]), names)
            figure.savefig(PICTURE, dpi=100, pil_kwargs={"optimize": True})
        os.chdir(PAGE.parent)
    print("written: docs/pictures/laboratory.png")


if __name__ == "__main__":
    main()
