"""The rate at which films are drawn and written."""

from __future__ import annotations

import importlib.util
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from crawler_model import load_scene, simulate
from crawler_pictures.film import encode, player
from crawler_pictures.film.film import Film, film_of_run, frame_times
from crawler_pictures.film.stage import Stage

from ..cases import CASES

FRAMES, QUICK = 100, 25
_FPS = 25.0
_ROUNDS = 3
SCENES = ("two_anchor_a", "three_contacts_two_ways", "ten_contact_wave", "planar_three_points", "wave_1000")
"""Scenes of the gallery, or cases of the comparison of methods."""


def measure_films(
    frames: int, progress: Callable[[float], None], names: Sequence[str] = SCENES
) -> list[dict[str, Any]]:
    """Measure films of bodies of two to a thousand contacts.

    Args:
        frames: frames of each film.
        progress: called with the fraction done, in [0, 1].
        names: scenes or cases to measure.

    Returns:
        A row for each scene and output: frames drawn alone, mp4 where PyAV is installed, gif, and html; frames per
        second (of frames the median of three rounds), seconds before the first frame, size of the file [byte].
    """
    drawn: list[dict[str, Any]] = []
    written: list[dict[str, Any]] = []
    scenes = [CASES[name]().scene if name in CASES else load_scene(name) for name in names]
    for done, scene in enumerate(scenes):
        times = frame_times(0.0, (frames - 1) / _FPS, _FPS, 1.0)
        film = film_of_run(scene, simulate(scene, float(times[-1]), _FPS)).sample(times)
        about: dict[str, Any] = {"scene": scene.name, "n": scene.body.contacts, "frames": times.size}
        drawn.append({"case": "frames drawn"} | about | _draw(film))
        writers: dict[str, Callable[..., None]] = {"gif": encode.write_gif, "html": player.write_html}
        if importlib.util.find_spec("av") is not None:
            writers["mp4"] = encode.write_mp4
        for suffix, write in writers.items():
            written.append({"case": "films written"} | about | {"output": suffix} | _write(film, write, suffix))
        progress((done + 1) / len(scenes))
    return drawn + written


def _draw(film: Film) -> dict[str, float]:
    begin = time.perf_counter()
    stage = Stage(film)
    stage.draw(0)
    first, spent = time.perf_counter() - begin, []
    for _ in range(_ROUNDS):
        begin = time.perf_counter()
        for k in range(film.time.size):
            stage.draw(k)
        spent.append(time.perf_counter() - begin)
    return {"frames_per_s": film.time.size / statistics.median(spent), "first_s": first}


def _write(film: Film, write: Callable[..., None], suffix: str) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"film.{suffix}"
        begin = time.perf_counter()
        write(film, file, _FPS, lambda part: None)
        spent = time.perf_counter() - begin
        return {"frames_per_s": film.time.size / spent, "bytes": file.stat().st_size}
