"""The moving panels of a film: the body on its track, and the moving set with the point it pushes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ..colors import BACK, FORWARD, GREY, STALLED, YIELDING
from ..domain_text import FACE, SECTION
from .camera import watch_set, watch_track
from .film import Film
from .moving_set import MovingSet
from .track import DEPTH, Track

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

MOST_CONTACTS, MOST_ARROWS, MOST_COILS = 400, 60, 60
"""Contacts that are drawn, contacts with an arrow while they slide, and springs that are drawn as coils."""
_MOST_NAMED = 16
_WIDTH_PT, _ROOM_PT = 860.0, 17.0
"""Width of the track, and room for the numbers of an axis that moves along [points]."""
Rolling: TypeAlias = "tuple[Axes, np.ndarray, np.ndarray]"
"""Axes, and their left and right limits in each frame."""
_DARK = "#202020"
_COLORS = {0: "#9a9a9a", 1: FORWARD, -1: BACK}
_YIELDS = {-1: "thin grey slack", 1: "magenta stalled", 2: "violet yielding"}
_ARROW = ((-1.0, 0.16), (0.1, 0.16), (0.1, 0.5), (1.0, 0.0), (0.1, -0.5), (0.1, -0.16), (-1.0, -0.16), (-1.0, 0.16))


def chosen_contacts(film: Film) -> np.ndarray:
    """Choose the contacts that are drawn.

    Args:
        film: the film.

    Returns:
        Their indices: all of at most 400, else 400 evenly spaced ones.
    """
    n = len(film.names)
    return np.arange(n) if n <= MOST_CONTACTS else np.linspace(0, n - 1, MOST_CONTACTS).round().astype(np.int64)


def chosen_springs(film: Film, chosen: np.ndarray) -> np.ndarray:
    """Choose the springs that are drawn, as pairs of drawn contacts.

    Args:
        film: the film.
        chosen: the contacts that are drawn.

    Returns:
        Indices into `chosen`, shape (J, 2): all springs where all contacts are drawn, else one between neighbours.
    """
    if chosen.size == len(film.names):
        return film.ends
    return np.column_stack((np.arange(chosen.size - 1), np.arange(1, chosen.size)))


def bows(rest: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Count the contacts over which each spring of a body on a line passes; these springs are drawn as arches.

    Args:
        rest: reference positions, shape (N,) [m].
        joints: the two contacts of each spring, shape (J, 2).

    Returns:
        Shape (J,).
    """
    rank = np.argsort(np.argsort(rest))
    return np.asarray(np.abs(np.diff(rank[joints], axis=1)[:, 0]) - 1.0)


def coils(start: np.ndarray, end: np.ndarray, width: float, bow: np.ndarray, teeth: int) -> np.ndarray:
    """Draw springs between points as zigzags, one after another, separated by NaN.

    Args:
        start: shape (J, 2).
        end: shape (J, 2).
        width: half of the width of the zigzag, in units of the second axis.
        bow: height of an arch over which each spring is drawn, shape (J,).
        teeth: number of its teeth; 0 for straight lines.

    Returns:
        Shape (J (2 teeth + 4), 2).
    """
    part = np.concatenate(
        ([0.0, 0.12], 0.12 + 0.76 * (np.arange(2 * teeth) + 0.5) / (2 * teeth) if teeth else [], [0.88, 1.0])
    )
    side = np.concatenate(([0.0, 0.0], width * (1.0 - 2.0 * (np.arange(2 * teeth) % 2)), [0.0, 0.0]))
    along = end - start
    size = np.linalg.norm(along, axis=1, keepdims=True)
    across = np.column_stack((-along[:, 1], along[:, 0])) / np.where(size > 0.0, size, 1.0)
    height = side + 4.0 * bow[:, None] * part * (1.0 - part)
    line = start[:, None] + part[:, None] * along[:, None] + height[..., None] * across[:, None]
    return np.concatenate((line, np.full((line.shape[0], 1, 2), np.nan)), axis=1).reshape(-1, 2)


def rigid_springs(place: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Find the springs that are drawn as rods: their length never changes by more than a hundredth.

    Args:
        place: positions in each frame, shape (F, N, 2) [m].
        joints: the two contacts of each spring, shape (J, 2).

    Returns:
        Shape (J,).
    """
    length = np.linalg.norm(place[:, joints[:, 1]] - place[:, joints[:, 0]], axis=2)
    return np.asarray(np.ptp(length, axis=0) <= 0.01 * length[0])


def ropes(start: np.ndarray, end: np.ndarray, sag: float, bow: np.ndarray) -> np.ndarray:
    """Draw slack links as lines that sag, one after another, separated by NaN.

    Args:
        start: shape (J, 2).
        end: shape (J, 2).
        sag: how far they sag in the middle, in units of the second axis.
        bow: height of an arch from which each sags, shape (J,).

    Returns:
        Shape (14 J, 2).
    """
    part = np.linspace(0.0, 1.0, 13)
    line = start[:, None] + part[:, None] * (end - start)[:, None]
    line[..., 1] += 4.0 * (bow[:, None] - sag) * part * (1.0 - part)
    return np.concatenate((line, np.full((line.shape[0], 1, 2), np.nan)), axis=1).reshape(-1, 2)


def explain_yields(film: Film, count: int) -> str:
    """Explain how links that are slack, stalled or yielding are drawn.

    Args:
        film: the film.
        count: number of springs that are drawn.

    Returns:
        The text that follows that on contacts; empty where there are none, or where not all springs are drawn.
    """
    if film.yields.shape[1] != count:
        return ""
    texts = [text for state, text in _YIELDS.items() if (film.yields == state).any()]
    return f"; links: {', '.join(texts)}" if texts else ""


class LinePanel:
    """The body on its track: contacts coloured by what they do, arrows where they slide, springs that stretch."""

    def __init__(self, axes: Axes, film: Film) -> None:
        """Draw what does not move, and create what does.

        Args:
            axes: axes of the panel.
            film: the film.
        """
        self._axes = axes
        chosen = chosen_contacts(film)
        self._place, self._state = film.place[:, chosen], film.state[:, chosen]
        self._joints = chosen_springs(film, chosen)
        self._bow = 0.55 * bows(film.rest[chosen], self._joints)
        self._left, self._right = watch_track(self._place, film.cycle_frames)
        self.rolling: Rolling | None = (axes, self._left, self._right) if np.ptp(self._left) > 0.0 else None
        n = chosen.size
        self._teeth = 4 if self._joints.shape[0] <= MOST_COILS else 0
        top = 1.5 + min(float(self._bow.max(initial=0.0)), 1.5)
        box = axes.get_window_extent()
        self._track = Track(film.scene, self._left, self._right, top, box.width / box.height)
        self._top = top + self._track.rise
        axes.set(yticks=[])
        self._watch(0)
        axes.set_xlabel("position on the track [m]", labelpad=1 if self.rolling is None else _ROOM_PT)
        if self.rolling is not None:
            axes.set_xticks([])
        axes.spines[["left", "right", "top"]].set_visible(False)
        ground = self._track.draw(axes)
        spacing = (
            float(np.median(np.diff(np.sort(self._place[0])))) / float(self._right[0] - self._left[0]) if n > 1 else 1.0
        )
        size = float(np.clip(0.7 * _WIDTH_PT * spacing, 3.0, 17.0))
        width = 1.4 if self._teeth else 1.0
        (self._links,) = axes.plot([], [], color=_DARK, linewidth=width, zorder=2)
        (self._stalled,) = axes.plot([], [], color=STALLED, linewidth=width + 1.2, zorder=2)
        (self._yielding,) = axes.plot([], [], color=YIELDING, linewidth=width + 1.2, zorder=2)
        (self._slack,) = axes.plot([], [], color=GREY, linewidth=1.2, zorder=2)
        limited = film.yields.shape[1] == self._joints.shape[0]
        self._yields = film.yields if limited else np.zeros((film.time.size, self._joints.shape[0]), np.int8)
        self._create_contacts(n, size)
        self._names = [_write_marker(axes, film.names[i]) for i in chosen] if n <= _MOST_NAMED else []
        self.moving: list[Artist] = [] if self.rolling is None else ground
        self.moving += [
            self._links,
            *([self._stalled, self._yielding, self._slack] if limited else []),
            *self._dots.values(),
            *self._arrows.values(),
            *self._names,
        ]
        title = "contacts: grey stick, green slip forward, red slip back" + explain_yields(film, len(self._joints))
        left_out = f"; {chosen.size} of {len(film.names)} contacts are drawn" if chosen.size < len(film.names) else ""
        left_out += "; for segments the ends are drawn" if len(film.names) < film.scene.body.contacts else ""
        axes.set_title(title + left_out, loc="left", fontsize=10)

    def _create_contacts(self, count: int, size: float) -> None:
        """Create the markers of contacts in each state, and the arrows of sliding contacts."""
        from matplotlib.path import Path

        self._dots: dict[int, Any] = {}
        self._arrows: dict[int, Any] = {}
        for state, color in _COLORS.items():
            edge = _DARK if size > 6.0 else "none"
            style: Any = {"linestyle": "", "color": color}
            (self._dots[state],) = self._axes.plot(
                [], [], "o", markersize=size, markeredgecolor=edge, zorder=3, **style
            )
            if state and count <= MOST_ARROWS:
                arrow = Path([(state * x, y) for x, y in _ARROW], closed=True)
                style |= {"marker": arrow, "markersize": min(1.3 * size, 20.0), "markeredgewidth": 0.0}
                (self._arrows[state],) = self._axes.plot([], [], zorder=4, **style)

    def move(self, k: int) -> None:
        """Move everything to a frame.

        Args:
            k: its number.
        """
        place, state = self._place[k], self._state[k]
        if self.rolling is not None:
            self._watch(k)
        ground = self._track.height(place)
        points = np.column_stack((place, ground + 0.35))
        for value, links in ((0, self._links), (1, self._stalled), (2, self._yielding), (-1, self._slack)):
            which = self._yields[k] == value
            links.set_data(*self._springs(points, which, value < 0).T)
            links.set_visible(bool(which.any()))
        for value, dots in self._dots.items():
            _put(dots, *points[state == value].T)
        for value, arrows in self._arrows.items():
            _put(arrows, place[state == value], ground[state == value] + 1.05)
        for x, y, text in zip(place, ground, self._names, strict=False):
            text.set_data([x], [y - 0.16])

    def _watch(self, k: int) -> None:
        """Show the part of the track that belongs to a frame."""
        low = self._track.low[k]
        self._axes.set(xlim=(self._left[k], self._right[k]), ylim=(low - DEPTH, low + self._top))

    def _springs(self, points: np.ndarray, which: np.ndarray, slack: bool) -> np.ndarray:
        """Draw some springs in the proportion of the screen, shape (K, 2)."""
        start, end = points[self._joints[which, 0]], points[self._joints[which, 1]]
        if slack:
            return ropes(start, end, 0.25, self._bow[which])
        unit = np.array([self._track.unit, 1.0])
        return coils(start / unit, end / unit, 0.17, self._bow[which], self._teeth) * unit


def _put(line: Any, place: np.ndarray, height: np.ndarray) -> None:
    """Put the markers of a line at places and heights, or hide it where there are none."""
    line.set_data(place, height)
    line.set_visible(place.size > 0)


def _write_marker(axes: Axes, text: str) -> Any:
    """Create a short text that moves as the marker of a line, which is drawn faster than a text."""
    from matplotlib.path import Path
    from matplotlib.textpath import TextPath

    path = TextPath((0.0, 0.0), text, size=1.0)
    middle = path.get_extents().get_points().mean(axis=0)
    # a marker is scaled so that its greatest coordinate is half of its size
    vertices = path.vertices - middle
    size = 2.0 * float(np.abs(vertices).max()) * 10.0
    return axes.plot(
        [], [], marker=Path(vertices, path.codes), linestyle="", color=_DARK, markersize=size, markeredgewidth=0.0
    )[0]


class SetPanel:
    """The moving set of the sweeping process, its sides coloured by direction, and the path of the point."""

    def __init__(self, axes: Axes, film: Film, moving: MovingSet) -> None:
        """Draw what does not move, and create what does.

        Args:
            axes: axes of the panel.
            film: the film.
            moving: the set and the point.
        """
        self._axes, self._set = axes, moving
        box = axes.get_window_extent()
        self._left, self._right, heights = watch_set(moving.outline, box.width / box.height, film.cycle_frames)
        self.rolling: Rolling | None = (axes, self._left, self._right) if np.ptp(self._left) > 0.0 else None
        axes.set(xlim=(self._left[0], self._right[0]), ylim=heights, xlabel=moving.labels[0], ylabel=moving.labels[1])
        axes.grid(alpha=0.3)
        axes.locator_params(nbins=6)
        if self.rolling is not None:
            axes.set_xticks([])
            axes.xaxis.labelpad = _ROOM_PT
        (self._face,) = axes.fill(*moving.outline[0].T, facecolor=FACE, edgecolor=GREY, linewidth=1.2, zorder=1)
        self._sides = {
            d: axes.plot([], [], color=c, linewidth=4.0, solid_capstyle="butt", zorder=2)[0]
            for d, c in ((0, SECTION), (1, FORWARD), (-1, BACK))
        }
        (self._trail,) = axes.plot([], [], color=_DARK, linewidth=1.2, zorder=3)
        (self._point,) = axes.plot([], [], "o", color=_DARK, markersize=8, zorder=4)
        self.moving: list[Artist] = [
            self._face,
            *self._sides.values(),
            self._trail,
            self._point,
        ]
        axes.set_title(moving.title, loc="left", fontsize=9)

    def move(self, k: int) -> None:
        """Move everything to a frame.

        Args:
            k: its number.
        """
        moving = self._set
        if self.rolling is not None:
            self._axes.set_xlim(self._left[k], self._right[k])
        self._face.set_xy(moving.outline[k])
        for direction, line in self._sides.items():
            chosen = moving.sides[k][moving.directions[k] == direction]
            line.set_data(*np.concatenate((chosen, np.full((chosen.shape[0], 1, 2), np.nan)), axis=1).reshape(-1, 2).T)
        self._trail.set_data(*moving.point[: k + 1].T)
        self._point.set_data(*moving.point[k : k + 1].T)
