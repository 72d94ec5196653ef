"""The ground in pictures: label and colours of each stretch of a track, walls, the profile, regions of the plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from crawler_model import Scene
from crawler_model.body.body import Body
from crawler_model.body.plan import Plan
from crawler_model.run.trajectory import TimedJump
from crawler_model.scene.friction_parts import ProfilePart
from crawler_model.scene.parts import WallPart

from .colors import JUMP, WALL, rgb

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_CURVE = 257
"""Points of a slope that changes along the track."""
_SOFTER, _HARDER, _MIXED, _SLOPED, _PLAIN = "#9fd0f0", "#d8b48a", "#c7b5de", "#d5dcc6", "#f4f3ee"
_SHADES = 48
"""Colours along a visible stretch on which friction changes."""


@dataclass(frozen=True)
class Section:
    """A stretch of the track that is marked in pictures: of a patch or a profile, or the place for the track's slope.

    Attributes:
        start: where it begins [m].
        end: where it ends [m].
        text: factors on friction and slope, as "friction ×0.5, slope 10° ↗", or "friction ×1 … ×0.4" along a profile.
        colors: of equal parts of its band, from start to end, as "#rrggbb"; none where it has no band.
    """

    start: float
    end: float
    text: str
    colors: tuple[str, ...]

    @property
    def bands(self) -> list[tuple[float, float, str]]:
        """The parts of its band: start [m], end [m] and colour."""
        edges = np.linspace(self.start, self.end, len(self.colors) + 1).tolist()
        return list(zip(edges[:-1], edges[1:], self.colors, strict=True))

    @property
    def middle(self) -> float:
        """The place for its text [m]."""
        return 0.5 * (self.start + self.end)


def list_sections(scene: Scene, left: float, right: float) -> list[Section]:
    """List the stretches to mark between two places.

    The slope of the track itself is written once, on the longest visible stretch that has no patch of another slope.

    Args:
        scene: the scene.
        left: left end of the visible track [m].
        right: its right end [m].

    Returns:
        The visible stretches of the profile and patches, which lie on them, cut at both places, then the stretch that
        shows the slope of the track; in the plane and on plain ground none.
    """
    ground = scene.parts.ground
    if ground is None:
        return []
    seen = [p for p in ground.patches if p.start < right and p.stop > left]
    found = _list_profile(ground.profile, left, right)
    for patch in seen:
        forward, backward = patch.factors
        written = (f"×{forward:g}", f"×{backward:g}")
        texts = [_write_factors(*written), "" if patch.slope is None else _write_slope(patch.slope)]
        colors = (_choose_color(forward, backward),)
        found.append(Section(max(patch.start, left), min(patch.stop, right), ", ".join(filter(None, texts)), colors))
    if ground.slope != 0.0:
        inside = [edge for p in seen for edge in (max(p.start, left), min(p.stop, right))]
        edges = np.array([left, *inside, right])
        gaps = np.diff(edges)[::2]
        if gaps.max() > 0.0:
            longest = int(2 * gaps.argmax())
            found.append(Section(float(edges[longest]), float(edges[longest + 1]), _write_slope(ground.slope), ()))
    return found


@dataclass(frozen=True)
class Area:
    """The visible part of a region of the plane.

    Attributes:
        corners: counterclockwise, shape (K, 2) [m].
        text: its factor on friction.
        color: as "#rrggbb".
    """

    corners: np.ndarray
    text: str
    color: str


def list_areas(scene: Plan, low: np.ndarray, high: np.ndarray) -> list[Area]:
    """List the visible parts of the regions of the ground.

    Args:
        scene: the scene.
        low: least coordinates that are visible, shape (2,) [m].
        high: largest coordinates, shape (2,) [m].

    Returns:
        A part of each region that is visible.
    """
    regions, found = scene.ground.regions, []
    for k, factor in enumerate(() if regions is None else regions.factors[:-1].tolist()):
        corners = np.array([low, (high[0], low[1]), high, (low[0], high[1])], np.float64)
        for normal, offset in zip(regions.normals[k], regions.offsets[k], strict=True):  # type: ignore[union-attr]
            corners = _cut(corners, corners @ normal - offset)
        if len(corners) >= 3:
            found.append(Area(corners, f"friction ×{factor:g}", _choose_color(factor, factor)))
    return found


def _cut(corners: np.ndarray, room: np.ndarray) -> np.ndarray:
    """Cut off the part of a convex polygon whose distance from a line is < 0."""
    kept = []
    for i in range(len(corners)):
        j = (i + 1) % len(corners)
        if room[i] >= 0.0:
            kept.append(corners[i])
        if (room[i] < 0.0) != (room[j] < 0.0):
            kept.append(corners[i] + (corners[j] - corners[i]) * room[i] / (room[i] - room[j]))
    return np.array(kept).reshape(-1, 2)


def draw_areas(axis: Axes, scene: Plan) -> None:
    """Shade the regions of the ground in the visible part of a picture from above.

    Args:
        axis: axes of m over m, which show all else already.
        scene: the scene.
    """
    from matplotlib.patches import Polygon

    low, high = np.array([axis.get_xlim(), axis.get_ylim()]).T
    for area in list_areas(scene, low - (high - low), high + (high - low)):  # equal scales may show more
        axis.add_artist(Polygon(area.corners, color=area.color, alpha=0.55, linewidth=0.0, zorder=0))
    for area in list_areas(scene, low, high):
        axis.annotate(area.text, area.corners.mean(axis=0), ha="center", fontsize=8, color="#505050", zorder=0.5)


def list_walls(scene: Scene, left: float, right: float) -> list[WallPart]:
    """List the walls between two places.

    Args:
        scene: the scene.
        left: left end of the visible track [m].
        right: its right end [m].

    Returns:
        The walls, in the order of the scene.
    """
    ground = scene.parts.ground
    return [] if ground is None else [wall for wall in ground.walls if left <= wall.at <= right]


def _list_profile(profile: ProfilePart | None, left: float, right: float) -> list[Section]:
    """List the visible stretches between the places of a profile, and those beyond its first and its last place."""
    if profile is None:
        return []
    ends = [-np.inf, *profile.at, np.inf]
    slopes = (0.0,) * len(profile.at) if profile.slope is None else profile.slope
    factors, found = np.array(profile.factors), []
    for j in range(len(ends) - 1):
        first, last = max(j - 1, 0), min(j, len(profile.at) - 1)
        if ends[j] >= right or ends[j + 1] <= left:
            continue
        start, end = max(ends[j], left), min(ends[j + 1], right)
        texts = [_write_factors(*(_write_range((row[first], row[last]), "×") for row in profile.factors))]
        slope = slopes[first], slopes[last]
        texts.append("" if slope == (0.0, 0.0) else f"slope {_write_range(slope)}°")
        changes = (factors[:, first] != factors[:, last]).any()
        places = start + (end - start) * (np.arange(_SHADES) + 0.5) / _SHADES if changes else [0.5 * (start + end)]
        colors: tuple[str, ...] = (_SLOPED,) * any(texts)
        if (factors != 1.0).any():
            colors = tuple(_shade(factors, *(np.interp(at, profile.at, row) for row in factors)) for at in places)
        found.append(Section(start, end, ", ".join(filter(None, texts)), colors))
    return found


def _write_range(ends: tuple[float, float], sign: str = "") -> str:
    first, last = (f"{sign}{value:g}" for value in ends)
    return first if first == last else f"{first} … {last}"


def trace_profile(scene: Scene, left: float, right: float) -> tuple[np.ndarray, np.ndarray]:
    """Compute the height of the track in true proportion, from 0 at its lowest visible point.

    Args:
        scene: the scene.
        left: left end of the visible track [m].
        right: its right end [m].

    Returns:
        Positions where the slope changes, both ends included, and heights there, each shape (P,) [m]; empty where all
        of it is level.
    """
    ground = scene.parts.ground
    patches = () if ground is None else ground.patches
    cuts = np.array([x for p in patches for x in (p.start, p.stop) if left < x < right])
    at = np.unique(np.concatenate(([left, right], cuts)))
    profile = None if ground is None else ground.profile
    if profile is not None and profile.slope is not None:  # curved between its places
        at = np.unique(np.concatenate((at, np.linspace(left, right, _CURVE))))
    middles = 0.5 * (at[1:] + at[:-1])
    slopes = np.full(middles.size, 0.0 if ground is None else ground.slope)
    if profile is not None and profile.slope is not None:
        slopes = np.degrees(np.arcsin(np.interp(middles, profile.at, np.sin(np.radians(profile.slope)))))
    for patch in patches:
        if patch.slope is not None:
            slopes[(middles > patch.start) & (middles < patch.stop)] = patch.slope
    if not slopes.any():
        return np.zeros(0), np.zeros(0)
    height = np.concatenate(([0.0], np.cumsum(np.diff(at) * np.tan(np.radians(slopes)))))
    return at, height - height.min()


def _write_factors(forward: str, backward: str) -> str:
    """Write the factors on friction; nothing where they are 1."""
    if forward == backward:
        return "" if forward == "×1" else f"friction {forward}"
    return f"friction {forward} →, {backward} ←"


def _write_slope(slope: float) -> str:
    """Write a slope with an arrow that shows where the ground goes towards +x."""
    return f"slope {slope:g}°" + (" ↗" if slope > 0.0 else " ↘" if slope < 0.0 else "")


def _choose_color(forward: float, backward: float) -> str:
    """Choose the colour of a patch: less friction, more, less in one direction and more in the other, or a slope."""
    least, most = min(forward, backward), max(forward, backward)
    if least == most == 1.0:
        return _SLOPED
    return _SOFTER if most <= 1.0 else _HARDER if least >= 1.0 else _MIXED


def _shade(factors: np.ndarray, forward: float, backward: float) -> str:
    """Choose the colour of a place of a profile: a patch's colour, fuller the farther its factors are from 1."""
    largest = np.abs((factors - 1.0) / (factors + 1.0)).max()  # as far for 1/c as for c
    part = max(abs(factor - 1.0) / (factor + 1.0) for factor in (forward, backward)) / largest
    full, plain = np.array(rgb(_choose_color(forward, backward))), np.array(rgb(_PLAIN))
    return "#{:02x}{:02x}{:02x}".format(*np.rint(plain + part * (full - plain)).astype(int))


def draw_walls(axis: Axes, scene: Scene) -> None:
    """Draw each wall as a line, with the direction of the contacts that it stops.

    Args:
        axis: positions on the track over time.
        scene: the scene.
    """
    for wall in () if scene.parts.ground is None else scene.parts.ground.walls:
        axis.axhline(wall.at, color=WALL, linewidth=2.0, zorder=1)
        arrow, side = ("↑", "top") if wall.stops == "forward" else ("↓", "bottom")
        where = (axis.get_xlim()[1], wall.at)
        axis.annotate(
            f"wall {arrow}",
            where,
            (-4, -2 if side == "top" else 2),
            fontsize=8,
            ha="right",
            va=side,
            textcoords="offset points",
            zorder=5,
            clip_on=True,
        )


def draw_jumps(axis: Axes, jumps: Sequence[TimedJump]) -> None:
    """Draw each jump as a line from the border to where it ended, over a dotted line along the border.

    Args:
        axis: positions on the track over time, with a legend to come.
        jumps: the jumps.
    """
    placed = [(jump, jump.border) for jump in jumps if jump.border is not None]
    for border in sorted({border for _, border in placed}):
        axis.axhline(border, color=JUMP, linewidth=0.6, linestyle=":", zorder=0)
    if placed:
        time, start = [jump.time for jump, _ in placed], [border for _, border in placed]
        axis.plot(time, start, "D", color=JUMP, markersize=4.5, zorder=4, label="jumps over a border (dotted)")
        ends = [border + jump.distance for jump, border in placed]
        axis.vlines(time, start, ends, color=JUMP, linewidth=2.2, zorder=4)


def has_stasis_bounds(body: Body) -> bool:
    """Return whether the bounds of each link's tension follow from its neighbours.

    Args:
        body: the body.

    Returns:
        True for a chain of isolated contacts.
    """
    return body.is_chain and not body.segments


def local_bounds(scene: Plan, target: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the bounds of the spring forces on a body on a line, by the ground under each contact.

    Args:
        scene: the scene.
        target: the target in force, shape (S + 2 N,) or with loads (S + 3 N,) [m, N].
        x: displacement of each contact, shape (N,) [m].

    Returns:
        Bounds forward and backward, each shape (N,) [N].
    """
    body, track = scene.body, scene.ground.track
    target, n = target[body.springs :], body.contacts
    if track is None:
        return target[:n], target[n : 2 * n]
    forward, backward, _ = track.local_bounds(target, body.position, x)
    return forward, backward
