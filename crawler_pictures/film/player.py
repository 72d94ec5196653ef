"""A film as one HTML file: numbers, and a script that draws them; it needs neither a codec nor a network."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ..colors import BACK, BOTH, FORWARD, GREY, STALLED, STICK, WALL, YIELDING
from ..domain_text import FACE, SECTION
from ..friction_marks import WORDS, friction_strokes
from ..ground import list_areas, list_sections, list_walls
from ..run.kymograph import HEIGHT, MOST_LINES, WIDTH
from ..run.pixels import divide, join_states
from .camera import watch_plane, watch_set, watch_track
from .film import Film
from .moving_set import moving_set
from .panels import MOST_ARROWS, MOST_COILS, bows, chosen_contacts, chosen_springs, rigid_springs
from .track import Track

_TEMPLATE = Path(__file__).with_name("player.html")
_MARK = '"DATA"'
_RATIO, _TRACK_RATIO = 1.2, 6.5
"""Width over height of the panels of the moving set and of the plane, and of the body on its track."""
_TOP = 1.7
"""Height of the body above the track."""


def write_html(film: Film, file: Path, fps: float, progress: Callable[[float], None]) -> None:
    """Write a film as a page with a time slider.

    Args:
        film: the run, sampled at the frames.
        file: the file to write.
        fps: frames per second at which it plays [Hz].
        progress: called with the fraction done, in [0, 1].
    """
    data = json.dumps(_describe_film(film, fps), allow_nan=False).replace("</", "<\\/")
    file.write_text(_TEMPLATE.read_text(encoding="utf-8").replace(_MARK, data), encoding="utf-8")
    progress(1.0)


def _describe_film(film: Film, fps: float) -> dict[str, Any]:
    """Collect what the script draws; arrays are base64 of little-endian numbers."""
    chosen, n = chosen_contacts(film), len(film.names)
    joints, place = chosen_springs(film, chosen), film.place[:, chosen]
    found: dict[str, Any] = {
        "name": film.scene.name,
        "fps": fps,
        "time": _pack(film.time, "<f8"),
        "planar": film.planar,
        "contacts": n,
        "names": [film.names[i] for i in chosen],
        "place": _pack(place),
        "state": _pack(film.state[:, chosen], "i1"),
        "joints": joints.tolist(),
        "path": _describe_path(film, chosen),
        "mean": _pack(film.net_translation + np.tensordot(film.share, film.rest, 1)),
        "moved": _pack(film.moved[:, chosen]) if film.planar else None,
        "arrows": chosen.size <= MOST_ARROWS,
        "coils": joints.shape[0] <= MOST_COILS,
        "colors": {"1": FORWARD, "0": "#9a9a9a", "-1": BACK, "2": BOTH, "stick": STICK, "grey": GREY}
        | {"face": FACE, "section": SECTION, "stalled": STALLED, "yielding": YIELDING, "wall": WALL},
        "yields": _pack(film.yields, "i1") if film.yields.shape[1] == joints.shape[0] else None,
        "strokes": None,
        "kymograph": None,
        "set": None,
    }
    if film.planar:
        low, high = watch_plane(place, _RATIO)
        found["window"] = [*low.tolist(), *high.tolist()]
        found["rigid"] = rigid_springs(place, joints).tolist()
        areas = list_areas(film.scene, low, high)
        found["areas"] = [asdict(area) | {"corners": area.corners.tolist()} for area in areas]
        if film.scene.body.turning is not None and chosen.size <= MOST_ARROWS:
            reach = 0.07 * float((high - low).min())
            ends = np.array([friction_strokes(film.scene.body, points, reach) for points in film.place])
            found["strokes"] = {"ends": _pack(ends), "words": WORDS}
    else:
        sides = watch_track(place, film.cycle_frames)
        track = Track(film.scene, *sides, _TOP, _TRACK_RATIO)
        found["window"] = [*map(_pack, sides), _pack(track.low), _pack(track.low + track.rise + _TOP)]
        found["track"] = [track.at.tolist(), track.heights.tolist()]
        found["bows"] = bows(film.rest[chosen], joints).tolist()
        found["ground"] = _list_ground(film)
        found["walls"] = [[wall.at, wall.stops == "forward"] for wall in list_walls(film.scene, -np.inf, np.inf)]
    if film.planar or n > MOST_LINES:
        path = film.path
        image = join_states(path.state[1:], *divide(path.time, min(WIDTH, path.time.size - 1))).T
        if n > HEIGHT:
            image = join_states(image, *divide(np.arange(n + 1.0), HEIGHT))
        found["kymograph"] = {"rows": image.shape[0], "columns": image.shape[1], "state": _pack(image, "i1")}
    swept = moving_set(film)
    if swept is not None:
        left, right, heights = watch_set(swept.outline, _RATIO, film.cycle_frames)
        found["set"] = {
            "title": swept.title.replace("$", ""),
            "labels": [label.replace("$", "") for label in swept.labels],
            "outline": _pack(swept.outline),
            "corners": swept.outline.shape[1],
            "sides": _pack(swept.sides),
            "directions": _pack(swept.directions, "i1"),
            "point": _pack(swept.point),
            "window": [_pack(left), _pack(right), *heights],
        }
    return found


def _describe_path(film: Film, chosen: np.ndarray) -> dict[str, str]:
    """Collect what the panels over time draw: the ticks at the frames, and those after which states change."""
    path = film.path
    changed = np.flatnonzero((path.state[1:, chosen] != path.state[:-1, chosen]).any(axis=1))
    nearest = np.minimum(np.searchsorted(path.time, film.time), path.time.size - 1)
    kept = np.unique(np.concatenate((nearest, changed)))
    found = {"time": _pack(path.time[kept], "<f8"), "net": _pack(path.net_translation[kept])}
    if not film.planar and chosen.size <= MOST_LINES:
        found["place"] = _pack(path.place[kept][:, chosen])
        found["state"] = _pack(path.state[kept][:, chosen], "i1")
    return found


def _pack(values: np.ndarray, kind: str = "<f4") -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


def _list_ground(film: Film) -> list[dict[str, Any]]:
    """List the marked stretches of the track that the film passes."""
    place = film.place
    reach = float(np.ptp(place))
    sections = list_sections(film.scene, float(place.min()) - reach, float(place.max()) + reach)
    return [asdict(section) for section in sections]
