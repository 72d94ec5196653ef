"""Draw every body of the gallery as it moves: the pictures of the gallery and of the home page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from crawler_model import gallery, load_scene, simulate
from crawler_pictures.film.film import film_of_run
from crawler_pictures.film.panels import LinePanel
from crawler_pictures.film.plane_panel import PlanePanel

FOLDER = Path(__file__).parent / "pictures" / "bodies"
WIDTH, HEIGHT, DPI = 3.2, 1.6, 100


def draw(name: str, file: Path) -> None:
    """Draw a body where it jumps, or else at the instant of its first period, after a third of it, at which most slide.

    Args:
        name: of the scene.
        file: the picture to write.
    """
    scene = load_scene(name)
    jumps = () if scene.dimension == 2 else simulate(scene).jumps
    run = simulate(scene) if jumps else simulate(scene, scene.drive.period)
    film = film_of_run(scene, run)
    figure = Figure(figsize=(WIDTH, HEIGHT), dpi=DPI)
    axes = figure.add_axes((0.02, 0.02, 0.96, 0.96))
    panel: Any = PlanePanel(axes, film) if film.planar else LinePanel(axes, film)
    sliding = (film.state != 0).sum(axis=1)
    sliding[: film.time.size // 3] = -1
    panel.move(int(np.argmax(run.time >= jumps[0].time)) if jumps else int(np.argmax(sliding)))
    axes.set(title="", xlabel="", ylabel="")
    axes.set_title("", loc="left")
    axes.set_axis_off()
    figure.savefig(file)


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name in gallery():
        draw(name, FOLDER / f"{name}.png")
