"""Pictures of the stasis domain of two contacts: boxes, intervals in them, and the sweeping process."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from crawler_model import Trajectory
from crawler_model.body.drive import NS
from crawler_model.body.plan import Plan
from crawler_model.theory.stasis import StasisDomain, directions_of, domain_evolution

from .colors import ACTUATION, BACK, CONTACTS, FORWARD, GREY
from .domain_text import (
    FACE,
    MOST_TIMES,
    SECTION,
    TRANSLATION,
    friction_at,
    is_constant,
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


_DASHES = ("-", "--", ":", "-.")
_LETTERS = "abcdefghi"


def draw_two(scene: Plan, run: Trajectory) -> Figure:
    """Draw the page of two contacts."""
    shown = shown_waypoints(scene)
    moves = run.time.size > 1
    swept = moves and is_constant(scene) and scene.body.springs == 1 and not scene.body.bends
    rows: list[Any]
    if not moves:
        rows, heights, size = [["box_0"]], [1.0], (5.5, 5.5)
    elif swept and page().narrow:
        rows, heights, size = [["box_0"], ["sweep"], ["motion"], ["band"]], [1.7, 1.2, 1.0, 1.0], (11.0, 14.0)
    elif swept:
        rows = [["box_0", "sweep", "sweep"], ["motion"] * 3, ["band"] * 3]
        heights, size = [2.0, 1.0, 1.0], (11.0, 10.0)
    else:
        count = len(shown) if len(shown) > 1 else 3
        top = [f"box_{i}" if i < len(shown) else "." for i in range(count)]
        across = min(count, 2) if page().narrow else count
        top += ["."] * (-count % across)
        rows = [top[i : i + across] for i in range(0, count, across)]
        heights = [(6.0 if page().narrow else 11.0) / across + 0.3] * len(rows) + [3.6, 2.4]
        rows += [["band"] * across, ["motion"] * across]
        size = (11.0, sum(heights))
    figure = open_figure(*size, stacked=moves)
    axes = figure.subplot_mosaic(rows, height_ratios=heights)
    figure.suptitle(f"{title(scene)}\n{verdict([domain for _, domain in shown])}", fontsize=11)
    reach = max(float(max(domain.forward.max(), domain.backward.max())) for _, domain in shown) or 1.0
    for i, (time_s, domain) in enumerate(shown):
        axis = axes[f"box_{i}"]
        draw_box(axis, domain, reach, len(shown) <= 1)
        axis.set_title(f"t = {time_s:.3g} s" if len(shown) > 1 else "the box C of both spring forces, and its section")
        axis.set_xlabel("$(g_0 + g_1)/2$ [N]")
        if axis.get_subplotspec().is_first_col():
            axis.set_ylabel(f"${symbol(scene)} = (g_0 - g_1)/2$ [N]\n(> 0: stretched)")
        else:
            axis.tick_params(labelleft=False)
    if not moves:
        axes["box_0"].plot(0.0, section_path(scene, run.tension)[0, 0], "o", color="black", markersize=5)
        return figure
    marks = _marked_instants(run, swept)
    draw_band(axes["band"], run)
    draw_motion(axes["motion"], run)
    lowest = axes["band"] if swept else axes["motion"]
    between = ", and some between" if swept else ""
    dotted = f"; dotted: ticks beside which sliding begins or ends{between}"
    lowest.set_xlabel("simulated time [s]" + ("" if page().narrow else dotted))
    for name in ("band", "motion"):
        axes[name].set_xlim(run.time[0], run.time[-1])
        for row in marks:
            axes[name].axvline(run.time[row], color="black", linewidth=0.8, linestyle=":")
        if axes[name] is not lowest:
            axes[name].tick_params(labelbottom=False)
    if swept:
        draw_sweeping(axes["sweep"], run, marks)
    for i, row in enumerate(marks if swept or not page().narrow else ()):
        text, fontsize = (_LETTERS[i], 10) if swept else (f"{run.time[row]:.3g}", 7)
        frame: Any = ("data", "axes fraction")
        where = (float(run.time[row]), 1.0)
        axes["motion"].annotate(
            text, where, (0, 3), xycoords=frame, textcoords="offset points", ha="center", fontsize=fontsize
        )
    return figure


def _actuation(run: Trajectory) -> np.ndarray:
    """Interpolate the actuation at the ticks of a run, shape (T, springs) [m]."""
    return run.scene.drive.sample(np.rint(run.time * NS).astype(np.int64))[:, : run.scene.body.springs]


def _turned(force: np.ndarray) -> np.ndarray:
    """Turn the plane of two spring forces by 45 degrees: half their sum to the right, half their difference up.

    Where the forces balance, g = (T, -T), the second coordinate is the tension itself, in newtons.
    """
    g = np.asarray(force, dtype=np.float64)
    return np.stack((g[..., 0] + g[..., 1], g[..., 0] - g[..., 1]), axis=-1) / 2.0


def box_corners(domain: StasisDomain) -> np.ndarray:
    """Compute the corners of the box of both spring forces in the turned plane of `_turned`.

    Args:
        domain: domain of two contacts.

    Returns:
        Shape (4, 2) [N].
    """
    plus, minus = domain.forward, domain.backward
    corners = [[plus[0], plus[1]], [-minus[0], plus[1]], [-minus[0], -minus[1]], [plus[0], -minus[1]]]
    return _turned(np.array(corners))


def draw_box(axis: Axes, domain: StasisDomain, reach: float, large: bool = True) -> None:
    """Draw the box C, its section in red and, at the section's ends, normals in the direction of motion they allow.

    Args:
        axis: axes to draw on; their limits are set.
        domain: domain of two contacts.
        reach: the largest friction that must fit [N].
        large: whether there is room to name the contact that slides.
    """
    limit = 1.62 * reach
    axis.set(xlim=(-limit, limit), ylim=(-limit, limit), aspect="equal")
    axis.axhline(0.0, color="#c0c0c0", linewidth=0.8)
    axis.axvline(0.0, color="#c0c0c0", linewidth=0.8)
    axis.locator_params(nbins=6)
    for i, force in enumerate(np.eye(2)):
        ends = _turned(np.outer([-1.0, 1.0], force)) * 2.4 * reach
        axis.plot(*ends.T, color=GREY, linewidth=0.8, linestyle="--", zorder=1)
        tip = _turned(force) * 2.55 * reach
        axis.annotate(f"$g_{i}$", tuple(tip), ha="center", va="bottom" if i == 0 else "top", color=GREY)
    axis.fill(*box_corners(domain).T, facecolor="#e8e8e8", edgecolor="#303030", linewidth=1.2, zorder=2)
    ends = domain.vertices()[:, 0]
    axis.plot([0.0, 0.0], ends, color=SECTION, linewidth=4.0 if large else 3.0, solid_capstyle="butt", zorder=3)
    facets = domain.facets()
    for facet in facets:
        upper = facet.normal[0] > 0.0
        end = np.array([0.0, ends[1] if upper else ends[0]])
        color = FORWARD if facet.direction > 0 else BACK
        push = np.zeros(2)
        push[facet.contact] = facet.direction
        tip = end + _turned(push) * 0.75 * reach
        arrow = {"arrowstyle": "-|>", "color": color, "linewidth": 2.0, "shrinkA": 0, "shrinkB": 0}
        axis.annotate("", tuple(tip), tuple(end), arrowprops=arrow, zorder=4)
        axis.annotate(
            TRANSLATION[facet.direction] + f"\ncontact {facet.contact}" * large,
            (tip[0], tip[1]),
            (0, 3 if upper else -3),
            textcoords="offset points",
            color=color,
            ha="center",
            va="bottom" if upper else "top",
            zorder=5,
        )
    if not facets:
        style: Any = {"textcoords": "offset points", "color": GREY, "va": "bottom", "ha": "center"}
        box = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
        axis.annotate("critical", (0.0, ends[1]), (0, 4), bbox=box, zorder=5, **style)


def draw_band(axis: Axes, run: Trajectory) -> None:
    """Draw the stasis interval over time as a band, its ends coloured by direction, and the tension in it.

    Args:
        axis: axes to draw on.
        run: run of two contacts.
    """
    scene, drive = run.scene, run.scene.drive
    repeats = [0.0] if drive.period is None else np.arange(0.0, run.time[-1], drive.period)
    time_s = np.unique(np.concatenate([run.time, *(start + drive.times for start in repeats)]))
    time_s = time_s[time_s <= run.time[-1]]
    plus, minus = friction_at(scene, time_s)
    bounds = {0: (plus[:, 0], -minus[:, 0]), 1: (minus[:, 1], -plus[:, 1])}
    least, most = np.maximum(bounds[0][1], bounds[1][1]), np.minimum(bounds[0][0], bounds[1][0])
    axis.fill_between(time_s, least, most, color=FACE, linewidth=0)
    if not is_constant(scene):
        for contact, (upper, lower) in bounds.items():
            label = f"{'bounds' if scene.columns.loads else 'friction'} of contact {contact}"
            axis.plot(time_s, upper, color=CONTACTS[contact], linewidth=1.0, label=label)
            axis.plot(time_s, lower, color=CONTACTS[contact], linewidth=1.0)
    half = (time_s[:-1] + time_s[1:]) / 2.0
    mid_plus, mid_minus = friction_at(scene, half)
    for bound, lead in (
        (most, mid_minus[:, 1] - mid_plus[:, 0]),  # > 0: contact 0 slides forward first
        (least, mid_minus[:, 0] - mid_plus[:, 1]),
    ):
        near = 1e-12 * (mid_plus + mid_minus).sum(axis=1)
        colors = np.where(lead > near, FORWARD, np.where(lead < -near, BACK, GREY))
        starts = [0, *(np.flatnonzero(colors[1:] != colors[:-1]) + 1), colors.size]
        for begin, end in itertools.pairwise(starts):
            stretch = slice(begin, end + 1)
            axis.plot(time_s[stretch], bound[stretch], color=str(colors[begin]), linewidth=2.8, zorder=2.5)
    for direction, color in ((1, FORWARD), (-1, BACK)):
        if direction in directions_of(domain_evolution(drive)[1]):
            label = f"end of the interval, {TRANSLATION[direction]}"
            axis.plot([], [], color=color, linewidth=2.6, label=label)
    axis.plot(
        run.time,
        section_path(scene, run.tension)[:, 0],
        "--",
        color="black",
        linewidth=1.5,
        label=quantity(scene),
        zorder=3,
    )
    axis.set_ylabel(f"{quantity(scene)} [N]\n(> 0: stretched)")
    axis.margins(y=0.08)
    axis.legend(
        loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=1 if page().narrow else 5, fontsize=8, frameon=False
    )


def draw_motion(axis: Axes, run: Trajectory) -> None:
    """Draw actuation, displacements and net translation over time.

    Args:
        axis: axes to draw on.
        run: run of two contacts.
    """
    actuation = _actuation(run)[:, : len(_DASHES)]
    for i in range(actuation.shape[1]):
        name = "actuation $L$" if actuation.shape[1] == 1 else f"actuation $L_{i}$"
        axis.plot(run.time, actuation[:, i], _DASHES[i], color=ACTUATION, linewidth=1.3, label=name)
    for contact in (0, 1):
        axis.plot(
            run.time, run.displacement[:, contact], color=CONTACTS[contact], linewidth=1.5, label=f"$x_{contact}$"
        )
    axis.plot(run.time, run.net_translation, color=FORWARD, linewidth=1.8, label="net translation $y$")
    axis.set_ylabel("length [m]")
    axis.legend(
        loc="lower center", bbox_to_anchor=(0.5, 1.08), ncols=2 if page().narrow else 8, fontsize=8, frameon=False
    )


def _marked_instants(run: Trajectory, middles: bool) -> list[int]:
    """Choose a limited number of ticks at which sliding begins or ends, optionally also the middles of slides."""
    step = np.diff(run.displacement, axis=0)
    state = np.sign(step) * (np.abs(step) > 1e-9 * np.ptp(run.displacement))  # rounding within a tick is not a slide
    changes = np.flatnonzero((np.diff(state, axis=0) != 0).any(axis=1)) + 1
    if not middles:
        return [int(row) for row in changes[:MOST_TIMES]]
    marks = [0]
    for begin, end in zip([0, *changes], [*changes, run.time.size - 1], strict=True):
        slides = bool(state[begin].any())
        marks += [int(begin + end) // 2] * slides + [int(end)]
    return list(dict.fromkeys(marks))[: len(_LETTERS)]


def draw_sweeping(axis: Axes, run: Trajectory, marks: Sequence[int]) -> None:
    """Draw the sweeping process of two contacts and one spring: the moving box and the point that it pushes.

    With u = -2 k x and l = (-k L, k L) the spring forces are g = l + u - mean(u), and the law of motion becomes
    -udot in N_{C - l + mean(u)}(u): here the factor 2 k is exact, and everything is a force. In the turned plane of
    `_turned`, u is the point (-2 k y, k z) and its box is C moved to (-2 k y, k L). The first axis is reversed, so
    that the body moves forward where the point moves right; hence boxes appear as mirror images of C.

    Args:
        axis: axes to draw on; their limits and labels are set.
        run: run of two contacts and one linear spring under constant friction.
        marks: ticks at which the box is drawn, lettered from a, at most nine.
    """
    domain = domain_evolution(run.scene.drive)[1][0]
    stiffness = float(run.scene.body.stiffness[0])
    shape = stiffness * (run.displacement[:, 1] - run.displacement[:, 0])
    place = 2.0 * stiffness * run.net_translation
    centre = stiffness * _actuation(run)[:, 0]
    ends = domain.vertices()[:, 0]
    corners = box_corners(domain) * (-1.0, 1.0)
    right = float(corners[:, 0].max())
    used = slice(0, marks[-1] + 1)
    axis.plot(place[used], shape[used], "--", color="black", linewidth=1.3, zorder=3)
    letters: dict[tuple[float, float], str] = {}
    for letter, row in zip(_LETTERS, marks, strict=False):
        at = np.array([place[row], centre[row]])
        axis.fill(*(corners + at).T, facecolor="#00000008", edgecolor="#606060", linewidth=1.0, zorder=1)
        axis.plot([at[0]] * 2, at[1] + ends, color=SECTION, linewidth=3.0, solid_capstyle="butt", zorder=2)
        axis.plot(at[0], shape[row], "o", color="black", markersize=5, zorder=4)
        key = (round(float(place[row]), 9), round(float(centre[row]), 9))
        letters[key] = f"{letters[key]}, {letter}" if key in letters else letter
    side = corners[corners[:, 0].argmax()]
    for corner, text in letters.items():
        style: Any = {"textcoords": "offset points", "va": "center", "fontsize": 10, "zorder": 5}
        box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.5}
        axis.annotate(text, tuple(np.array(corner) + side), (4, 0), bbox=box, **style)
    axis.set(aspect="equal", xlabel="net translation $2 k y$ [N]  (right: forward)", ylabel="shape $k z$ [N]")
    axis.set_title("sweeping process: $k L$ moves the box vertically; horizontally it follows the point that it pushes")
    axis.set_xlim(right=float(place[used].max()) + 1.6 * right)
