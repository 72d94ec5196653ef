"""Pictures of the stasis domain of three contacts and more: polygons, projections, ranges."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from crawler_model import Trajectory
from crawler_model.body.body import Body
from crawler_model.body.plan import Plan
from crawler_model.theory.stasis import Facet, StasisDomain, domain_evolution, spring_force

from .colors import BACK, FORWARD, GREY, TENSION
from .domain_text import (
    FACE,
    MOST_BARS,
    SECTION,
    TRANSLATION,
    is_constant,
    label_of,
    last_period,
    quantity,
    section_path,
    shown_waypoints,
    symbol,
    title,
    verdict,
)
from .style import open_figure, page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D


def draw_three(scene: Plan, run: Trajectory) -> Figure:
    """Draw the page of three contacts."""
    shown = _distinct(shown_waypoints(scene))
    columns = 2 if len(shown) == 4 else min(len(shown), 2 if page().narrow else 3)
    rows = -(-len(shown) // columns)
    size = (7.0, 6.8) if len(shown) == 1 else (4.2 * columns, 4.3 * rows + 0.6)
    figure = open_figure(*size)
    grid = figure.subplots(rows, columns, squeeze=False)
    figure.suptitle(f"{title(scene)}\n{verdict([domain for _, domain in shown])}", fontsize=11)
    path = section_path(scene, run.tension)[last_period(run)]
    limits = _limits([domain.vertices() for _, domain in shown])
    for axis, (time_s, domain) in zip(grid.ravel(), shown, strict=False):
        draw_polygon(axis, domain, [f"contact {i}" for i in range(3)], len(shown) == 1)
        _draw_path(axis, path)
        if len(shown) > 1:
            axis.set_title(f"t = {time_s:.3g} s")
            here = section_path(scene, run.tension)[[_nearest(run, time_s)]]
            axis.plot(*here.T, "o", color="black", markersize=6, zorder=6)
        axis.set(xlim=limits[0], ylim=limits[1], xlabel=label_of(scene, 0), ylabel=label_of(scene, 1))
    for axis in grid.ravel()[len(shown) :]:
        axis.set_axis_off()
    return figure


def _distinct(shown: list[tuple[float, StasisDomain]]) -> list[tuple[float, StasisDomain]]:
    """Leave out repeated domains."""
    found = {(d.forward.tobytes(), d.backward.tobytes()): (t, d) for t, d in reversed(shown)}
    return list(reversed(found.values()))


def _nearest(run: Trajectory, time_s: float) -> int:
    """Find the tick of the last period at which the drive is at `time_s`."""
    rows = last_period(run)
    return int(rows[np.abs(run.time[rows] - run.time[rows[0]] - time_s).argmin()])


def _limits(polygons: Sequence[np.ndarray]) -> list[tuple[float, float]]:
    """Compute limits of square axes around polygons, wide enough for labels outside them."""
    corners = np.concatenate(polygons)
    low, high = corners.min(axis=0), corners.max(axis=0)
    half = (1.5 if page().narrow else 1.0) * float((high - low).max()) or 1.0
    return [(float(middle) - half, float(middle) + half) for middle in (low + high) / 2.0]


def draw_polygon(axis: Axes, domain: StasisDomain, names: Sequence[str], large: bool = True) -> None:
    """Draw a domain of three contacts, each side coloured by the direction that it allows.

    Args:
        axis: axes to draw on; the caller sets the limits.
        domain: domain of three contacts.
        names: names of the three contacts.
        large: whether there is room for large letters.
    """
    corners = domain.vertices()
    axis.set_aspect("equal")
    axis.locator_params(nbins=7)
    axis.axhline(0.0, color="#c8c8c8", linewidth=0.8, zorder=0)
    axis.axvline(0.0, color="#c8c8c8", linewidth=0.8, zorder=0)
    axis.fill(*corners.T, facecolor=FACE, edgecolor=GREY, linewidth=1.0, zorder=1)
    if corners.shape[0] < 3:
        axis.plot(*corners.T, "o-", color=GREY, linewidth=2.0, zorder=2)
        return
    for facet, a, b in sides_of(domain):
        color = FORWARD if facet.direction > 0 else BACK
        axis.plot(*np.array([a, b]).T, color=color, linewidth=5.0, solid_capstyle="round", zorder=2)
        out = facet.normal / np.abs(facet.normal).max()
        axis.annotate(
            f"{TRANSLATION[facet.direction]}\n{names[facet.contact]}",
            (a + b) / 2.0,
            tuple(out * 9.0),
            textcoords="offset points",
            color=color,
            fontsize=9 if large else 8,
            ha={1.0: "left", -1.0: "right"}.get(float(out[0]), "center"),
            va={1.0: "bottom", -1.0: "top"}.get(float(out[1]), "center"),
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.5},
            zorder=7,
        )


def sides_of(domain: StasisDomain) -> Iterator[tuple[Facet, np.ndarray, np.ndarray]]:
    """Find the sides of a polygon at which motion begins.

    Args:
        domain: domain of three contacts with at least three vertices.

    Yields:
        The facet, and both ends of its side, each shape (2,) [N].
    """
    corners = domain.vertices()
    following = np.roll(corners, -1, axis=0)
    for facet in domain.facets():
        bound = (domain.forward if facet.direction > 0 else domain.backward)[facet.contact]
        slack = bound - (corners + following) / 2.0 @ facet.normal
        side = int(slack.argmin())
        yield facet, corners[side], following[side]


def draw_box_in_space(axis: Axes3D, domain: StasisDomain) -> None:
    """Draw the box C of three spring forces and its section by the plane in which they balance.

    The sides of the section are coloured by the direction that they allow: each lies in the face of the box whose
    normal belongs to the contact that slides there.

    Args:
        axis: three-dimensional axes to draw on.
        domain: domain of three contacts.
    """
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    low, high = -domain.backward, domain.forward
    corners = np.array(list(itertools.product(*zip(low, high, strict=True))))
    edges = [(a, b) for a, b in itertools.combinations(corners, 2) if np.count_nonzero(a != b) == 1]
    axis.add_collection3d(Line3DCollection(edges, colors=GREY, linewidths=0.9))
    section = spring_force(domain.vertices())
    axis.add_collection3d(Poly3DCollection([section], facecolor=SECTION, alpha=0.45, edgecolor="none"))
    for facet, a, b in sides_of(domain):
        color = FORWARD if facet.direction > 0 else BACK
        axis.plot(*spring_force(np.array([a, b])).T, color=color, linewidth=3.5)
    axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axis.set(xlabel="$g_0$ [N]", ylabel="$g_1$ [N]", zlabel="$g_2$ [N]", aspect="equal")
    axis.locator_params(nbins=4)
    axis.grid(False)


def _draw_path(axis: Axes, path: np.ndarray, arrows: int = 6) -> None:
    """Draw a path, shape (T, 2), with arrows along it and a dot at its start."""
    axis.plot(*path.T, color="black", linewidth=1.3, zorder=4)
    axis.plot(*path[0], "o", color="black", markersize=7, zorder=5)
    run = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T)))) if path.shape[0] > 1 else np.zeros(1)
    if run[-1] == 0.0:
        return
    for part in (np.arange(arrows) + 0.5) / arrows:
        i = int(np.clip(np.searchsorted(run, part * run[-1]), 1, path.shape[0] - 1))
        style: dict[str, Any] = {
            "arrowstyle": "-|>",
            "color": "black",
            "shrinkA": 0,
            "shrinkB": 0,
            "mutation_scale": 17,
        }
        axis.annotate("", path[i], path[i - 1], arrowprops=style, zorder=5)


def draw_many(scene: Plan, run: Trajectory) -> Figure:
    """Draw the page of four contacts and more: two projections and the range of each section."""
    shown = _distinct(shown_waypoints(scene))
    path = section_path(scene, run.tension)[last_period(run)]
    first, which_first = ((0, 1), "the first two sections")
    if scene.body.segments:
        first, which_first = _between_parts(scene.body), "sections that divide the body"
    pairs = list(dict.fromkeys([first, _most_variable(path)]))
    names = [f"onto_{i}" for i in range(len(pairs))]
    rows: list[Any] = [[name] for name in names] if page().narrow else [names]
    figure = open_figure(5.6 * len(rows[0]) + 0.4, 5.6 * len(rows) + 3.4, stacked=not page().narrow)
    axes = figure.subplot_mosaic([*rows, ["ranges"] * len(rows[0])], height_ratios=[2] * len(rows) + [1.2])
    figure.suptitle(f"{title(scene)}\n{verdict([domain for _, domain in shown])}", fontsize=11)
    for name, pair in zip(names, pairs, strict=True):
        _draw_projections(axes[name], scene, [domain for _, domain in shown], pair, path)
        which = which_first if pair == first else "the two that change most"
        others = f"\nat t = 0, grey: at {len(shown) - 1} other waypoints" if len(shown) > 1 else ""
        axes[name].set_title(f"projection onto {which}{others}")
    _draw_ranges(axes["ranges"], scene, path)
    return figure


def _between_parts(body: Body) -> tuple[int, int]:
    """Find the first two sections between contacts and segments; where there are fewer, thirds of the body."""
    inside = {i for s in body.segments for i in range(s.first, s.last)}
    between = [i for i in range(body.contacts - 1) if i not in inside]
    thirds = [body.contacts // 3 - 1, 2 * body.contacts // 3 - 1]
    first, second = (between + [i for i in thirds if i not in between])[:2]
    return min(first, second), max(first, second)


def _most_variable(path: np.ndarray) -> tuple[int, int]:
    """Find the two sections that change most; in a long body at least a quarter of its length apart."""
    travel = np.ptp(path, axis=0)
    first = int(travel.argmax())
    apart = 1 if travel.size <= MOST_BARS else travel.size // 4
    far = np.abs(np.arange(travel.size) - first) >= apart
    second = int(np.where(far, travel, -1.0).argmax())
    return min(first, second), max(first, second)


def _draw_projections(
    axis: Axes, scene: Plan, domains: Sequence[StasisDomain], pair: tuple[int, int], path: np.ndarray
) -> None:
    """Draw the projections of all domains, the first with its sides marked."""
    merged = [domain.merged(*pair) for domain in domains]
    bounds = [0, pair[0] + 1, pair[1] + 1, domains[0].contacts]
    groups = [f"contact {a}" if b - a == 1 else f"contacts {a} to {b - 1}" for a, b in itertools.pairwise(bounds)]
    if scene.body.segments:
        at = scene.body.position
        groups = [
            f"{at[a]:.3g} m" if b - a == 1 else f"{at[a]:.3g} to {at[b - 1]:.3g} m"
            for a, b in itertools.pairwise(bounds)
        ]
    for domain in merged[1:]:
        axis.fill(*domain.vertices().T, facecolor="none", edgecolor=GREY, linewidth=0.9, zorder=1)
    draw_polygon(axis, merged[0], groups)
    _draw_path(axis, path[:, pair])
    limits = _limits([*(domain.vertices() for domain in merged), path[:, pair]])
    axis.set(xlim=limits[0], ylim=limits[1], xlabel=label_of(scene, pair[0]), ylabel=label_of(scene, pair[1]))


def _draw_ranges(axis: Axes, scene: Plan, path: np.ndarray) -> None:
    """Draw the range of each section, and the part of it that the run uses."""
    least, most = (np.array(side) for side in zip(*(d.ranges() for d in domain_evolution(scene.drive)[1]), strict=True))
    sections = np.arange(path.shape[1])
    at, length = sections, np.ones(sections.size)
    if scene.body.segments:
        ends = scene.body.position
        at, length = 0.5 * (ends[:-1] + ends[1:]), np.diff(ends)
    label = "possible in stasis" if is_constant(scene) else "possible in stasis at a waypoint"
    _draw_bars(axis, at, least.min(axis=0), most.max(axis=0), 0.8 * length, label, color=FACE)
    _draw_bars(axis, at, path.min(axis=0), path.max(axis=0), 0.35 * length, "used in the last period", color=TENSION)
    edge = {"edgecolor": "#000000", "linewidth": 1.5}
    label = "" if is_constant(scene) else "possible in stasis at every waypoint"
    _draw_bars(axis, at, least.max(axis=0), most.min(axis=0), 0.8 * length, label, facecolor="none", **edge)
    axis.use_sticky_edges = False
    axis.margins(x=0.02, y=0.06)
    axis.axhline(0.0, color=GREY, linewidth=0.8)
    axis.set_xlabel("link" if symbol(scene) == "T" else "section")
    if scene.body.segments:
        axis.set_xlabel("place along the body [m]")
    else:
        axis.set_xticks(sections if sections.size <= 20 else [0, sections.size - 1])
    axis.set_ylabel(f"{quantity(scene)} [N]\n(> 0: stretched)")
    axis.legend(
        loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=1 if page().narrow else 3, fontsize=8, frameon=False
    )


def _draw_bars(
    axis: Axes, at: np.ndarray, low: np.ndarray, high: np.ndarray, width: np.ndarray, label: str, **style: Any
) -> None:
    """Draw a bar for each section at its place, or a band when there are many."""
    if low.size <= MOST_BARS:
        axis.bar(at, high - low, width, low, label=label or None, **style)
    else:
        axis.fill_between(at, low, high, label=label or None, **style)
