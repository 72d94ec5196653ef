"""Pictures of stasis domains: where nothing moves, which way each side lets the body go, and the path of a run in them.

Tensions are drawn as they are, positive when stretched; [G] draws the same sets in -T.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crawler_model import Scene, Trajectory, simulate
from crawler_model.body import Body
from crawler_model.planar_kernel import corners_of
from crawler_model.stasis import Facet, StasisDomain, directions_of, domain_evolution, section_forces, spring_force

from .colors import ACTUATION, BACK, CONTACTS, FORWARD, GREY, TENSION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

STYLE = {"font.size": 9, "axes.titlesize": 9, "mathtext.fontset": "dejavusans"}
"""matplotlib settings of these pictures."""
_FACE, _SECTION = "#f2dcda", "#e0605a"
_MOST_PANELS, _MOST_TIMES, _MOST_BARS = 6, 16, 40
_SAMPLES, _MOST_SAMPLES = 1200, 4_000_000
_DASHES = ("-", "--", ":", "-.")
_LETTERS = "abcdefghi"
_TRANSLATION = {1: r"$v_m \geq 0$", -1: r"$v_m \leq 0$"}


def draw_domain(scene: Scene, png: Path) -> None:
    """Draw the stasis domain of a scene on one page, with the run of its drive in it.

    Two contacts: the box of both spring forces and its section, an interval; with constant friction also the sweeping
    process, with commanded friction the boxes at the waypoints; below, tension and interval over time. Three contacts:
    the polygon for each friction commanded, its sides marked with the direction they allow. More: projections onto
    two sections, and the range of each. In the plane: the forces that each contact's friction can bear, and the path
    of its spring force among them.

    Args:
        scene: the scene; without a drive, its start alone is drawn in the domain.
        png: the file to write.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    contacts = scene.mesh.contacts
    run = _simulated(scene, 2 if contacts == 2 else 3)
    draw = {2: _draw_two, 3: _draw_three}.get(contacts, _draw_many)
    if scene.mesh.dimension == 2:
        draw = _draw_plane
    with matplotlib.rc_context(STYLE):
        figure = draw(scene, run)
        figure.savefig(png, dpi=100, pil_kwargs={"optimize": True})
        plt.close(figure)


def _section_path(scene: Scene, tension: np.ndarray) -> np.ndarray:
    """Compute the section forces of a run, shape (T, N - 1) [N]: in a chain they are the tensions themselves."""
    return tension if scene.mesh.is_chain else section_forces(scene.mesh.spring_force(tension))


def _simulated(scene: Scene, periods: int) -> Trajectory:
    """Run a few periods of the drive, or the whole of one that does not repeat."""
    drive = scene.commands
    span = float(drive.times[-1]) if drive.period is None else drive.period * periods
    if span == 0.0:
        return simulate(scene, 0.0)
    ticks = int(np.clip(_MOST_SAMPLES / scene.mesh.contacts, 8 * periods, _SAMPLES * periods))
    return simulate(scene, span, float(np.clip(ticks / span, 1e-9, 1e9)))


def _last_period(run: Trajectory) -> np.ndarray:
    """Find the rows of a run's last period, or all of them."""
    period = run.scene.commands.period
    return np.flatnonzero(run.time >= (0.0 if period is None else run.time[-1] - period * (1.0 + 1e-9)))


def _is_constant(scene: Scene) -> bool:
    drive = scene.commands
    return not (np.ptp(drive.forward, axis=0).any() or np.ptp(drive.backward, axis=0).any())


def _shown_waypoints(scene: Scene) -> list[tuple[float, StasisDomain]]:
    """Choose the waypoints whose domains are drawn: one if friction is constant, else at most six."""
    times, domains = domain_evolution(scene.commands)
    if _is_constant(scene):
        return [(0.0, domains[0])]
    period = scene.commands.period
    rows = [i for i in range(len(domains)) if period is None or times[i] < period]
    if len(rows) > _MOST_PANELS:
        rows = [rows[len(rows) * i // _MOST_PANELS] for i in range(_MOST_PANELS)]
    return [(float(times[i]), domains[i]) for i in rows]


def friction_at(scene: Scene, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Read the friction that a scene commands.

    Args:
        scene: a body on a line.
        time_s: when, shape (T,) [s].

    Returns:
        mu_plus and mu_minus, straight lines between waypoints, each of shape (T, N) [N].
    """
    drive = scene.commands

    def read(rows: np.ndarray) -> np.ndarray:
        return np.column_stack([np.interp(time_s, drive.times, mu, period=drive.period) for mu in rows.T])

    return read(drive.forward), read(drive.backward)


def _verdict(domains: Sequence[StasisDomain]) -> str:
    """Say which ways the body can be made to go."""
    ways = directions_of(domains)
    if ways == {1, -1}:
        return "forward and backward motion are both possible"
    if ways:
        return f"only {'forward' if ways == {1} else 'backward'} motion is possible"
    return "no facet: at its boundary several contacts are at their bounds at once"


def _symbol(scene: Scene) -> str:
    return "T" if scene.mesh.is_chain else "Q"


def _quantity(scene: Scene) -> str:
    """Name what is drawn: in a chain sections and links are the same."""
    return "tension" if _symbol(scene) == "T" else "section force"


def _label(scene: Scene, section: int) -> str:
    if scene.mesh.segments:
        place = float(scene.mesh.position[section : section + 2].mean())
        return f"{_quantity(scene)} at {place:.3g} m [N]  (> 0: stretched)"
    return f"{_quantity(scene)} ${_symbol(scene)}_{{{section}}}$ [N]  (> 0: stretched)"


# Two contacts


def _draw_two(scene: Scene, run: Trajectory) -> Figure:
    """Lay out the page of two contacts."""
    from matplotlib import pyplot as plt

    shown = _shown_waypoints(scene)
    moves = run.time.size > 1
    swept = moves and _is_constant(scene) and scene.mesh.springs == 1
    rows: list[Any]
    if not moves:
        rows, heights, size = [["box_0"]], [1.0], (5.5, 5.5)
    elif swept:
        rows = [["box_0", "sweep", "sweep"], ["motion"] * 3, ["band"] * 3]
        heights, size = [2.0, 1.0, 1.0], (11.0, 10.0)
    else:
        count = len(shown) if len(shown) > 1 else 3
        top = [f"box_{i}" if i < len(shown) else "." for i in range(count)]
        rows, heights = [top, ["band"] * count, ["motion"] * count], [11.0 / count + 0.3, 3.6, 2.4]
        size = (11.0, sum(heights))
    figure, axes = plt.subplot_mosaic(rows, figsize=size, height_ratios=heights, layout="constrained")
    figure.suptitle(f"stasis domain: {scene.name}\n{_verdict([domain for _, domain in shown])}", fontsize=11)
    reach = max(float(max(domain.forward.max(), domain.backward.max())) for _, domain in shown) or 1.0
    for i, (time_s, domain) in enumerate(shown):
        axis = axes[f"box_{i}"]
        draw_box(axis, domain, reach, len(shown) <= 1)
        axis.set_title(f"t = {time_s:.3g} s" if len(shown) > 1 else "the box C of both spring forces, and its section")
        axis.set_xlabel("$(g_0 + g_1)/2$ [N]")
        if i == 0:
            axis.set_ylabel(f"${_symbol(scene)} = (g_0 - g_1)/2$ [N]\n(> 0: stretched)")
        else:
            axis.tick_params(labelleft=False)
    if not moves:
        axes["box_0"].plot(0.0, _section_path(scene, run.tension)[0, 0], "o", color="black", markersize=5)
        return figure
    marks = _marked_instants(run, swept)
    draw_band(axes["band"], run)
    draw_motion(axes["motion"], run)
    lowest = axes["band"] if swept else axes["motion"]
    lowest.set_xlabel("simulated time [s]")
    for name in ("band", "motion"):
        axes[name].set_xlim(run.time[0], run.time[-1])
        for row in marks:
            axes[name].axvline(run.time[row], color="black", linewidth=0.8, linestyle=":")
        if axes[name] is not lowest:
            axes[name].tick_params(labelbottom=False)
    if swept:
        draw_sweeping(axes["sweep"], run, marks)
    for i, row in enumerate(marks):
        text, fontsize = (_LETTERS[i], 10) if swept else (f"{run.time[row]:.4g} s", 7)
        frame: Any = ("data", "axes fraction")
        where = (float(run.time[row]), 1.0)
        axes["motion"].annotate(
            text, where, (0, 3), xycoords=frame, textcoords="offset points", ha="center", fontsize=fontsize
        )
    return figure


def _actuation(run: Trajectory) -> np.ndarray:
    """Read the actuation at a run's ticks, shape (T, springs) [m]."""
    drive = run.scene.commands
    columns = [np.interp(run.time, drive.times, column, period=drive.period) for column in drive.actuation.T]
    return np.column_stack(columns)


def _turned(force: np.ndarray) -> np.ndarray:
    """Turn the plane of two spring forces by 45 degrees: half their sum to the right, half their difference up.

    Where the forces balance, g = (T, -T), the second coordinate is the tension itself, in newtons.
    """
    g = np.asarray(force, dtype=np.float64)
    return np.stack((g[..., 0] + g[..., 1], g[..., 0] - g[..., 1]), axis=-1) / 2.0


def _box_corners(domain: StasisDomain) -> np.ndarray:
    plus, minus = domain.forward, domain.backward
    corners = [[plus[0], plus[1]], [-minus[0], plus[1]], [-minus[0], -minus[1]], [plus[0], -minus[1]]]
    return _turned(np.array(corners))


def draw_box(axis: Axes, domain: StasisDomain, reach: float, large: bool = True) -> None:
    """Draw the box C, its section in red and, at the section's ends, the normal that says which way they let go.

    Args:
        axis: where to; its limits are set.
        domain: of two contacts.
        reach: the largest friction that must find room [N].
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
    axis.fill(*_box_corners(domain).T, facecolor="#e8e8e8", edgecolor="#303030", linewidth=1.2, zorder=2)
    ends = domain.vertices()[:, 0]
    axis.plot([0.0, 0.0], ends, color=_SECTION, linewidth=4.0 if large else 3.0, solid_capstyle="butt", zorder=3)
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
            _TRANSLATION[facet.direction] + f"\ncontact {facet.contact}" * large,
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
        axis: where to.
        run: of two contacts.
    """
    scene, drive = run.scene, run.scene.commands
    repeats = [0.0] if drive.period is None else np.arange(0.0, run.time[-1], drive.period)
    time_s = np.unique(np.concatenate([run.time, *(start + drive.times for start in repeats)]))
    time_s = time_s[time_s <= run.time[-1]]
    plus, minus = friction_at(scene, time_s)
    bounds = {0: (plus[:, 0], -minus[:, 0]), 1: (minus[:, 1], -plus[:, 1])}
    least, most = np.maximum(bounds[0][1], bounds[1][1]), np.minimum(bounds[0][0], bounds[1][0])
    axis.fill_between(time_s, least, most, color=_FACE, linewidth=0)
    if not _is_constant(scene):
        for contact, (upper, lower) in bounds.items():
            label = f"friction of contact {contact}"
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
            label = f"end of the interval, {_TRANSLATION[direction]}"
            axis.plot([], [], color=color, linewidth=2.6, label=label)
    axis.plot(
        run.time,
        _section_path(scene, run.tension)[:, 0],
        "--",
        color="black",
        linewidth=1.5,
        label=_quantity(scene),
        zorder=3,
    )
    axis.set_ylabel(f"{_quantity(scene)} [N]\n(> 0: stretched)")
    axis.margins(y=0.08)
    axis.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=5, fontsize=8, frameon=False)


def draw_motion(axis: Axes, run: Trajectory) -> None:
    """Draw actuation, displacements and net translation over time.

    Args:
        axis: where to.
        run: of two contacts.
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
    axis.legend(loc="lower center", bbox_to_anchor=(0.5, 1.08), ncols=8, fontsize=8, frameon=False)


def _marked_instants(run: Trajectory, middles: bool) -> list[int]:
    """Choose the ticks at which sliding begins or ends, if wanted also the middles of the slides; not too many."""
    step = np.diff(run.displacement, axis=0)
    state = np.sign(step) * (np.abs(step) > 1e-9 * np.ptp(run.displacement))  # in a tick, rounding is no slide
    changes = np.flatnonzero((np.diff(state, axis=0) != 0).any(axis=1)) + 1
    if not middles:
        return [int(row) for row in changes[:_MOST_TIMES]]
    marks = [0]
    for begin, end in zip([0, *changes], [*changes, run.time.size - 1], strict=True):
        slides = bool(state[begin].any())
        marks += [int(begin + end) // 2] * slides + [int(end)]
    return list(dict.fromkeys(marks))[: len(_LETTERS)]


def draw_sweeping(axis: Axes, run: Trajectory, marks: Sequence[int]) -> None:
    """Draw the sweeping process of two contacts and one spring: the moving box and the point that it pushes along.

    With u = -2 k x and l = (-k L, k L) the spring forces are g = l + u - mean(u), and the law of motion becomes
    -udot in N_{C - l + mean(u)}(u): here the factor 2 k is exact, and everything is a force. In the turned plane of
    `_turned`, u is the point (-2 k y, k z) and its box is C moved to (-2 k y, k L). The first axis is reversed, so
    that the body goes forward where the point goes right; hence boxes appear as mirror images of C.

    Args:
        axis: where to; its limits and labels are set.
        run: of two contacts and one spring under constant friction.
        marks: ticks at which the box is drawn, lettered from a, at most nine.
    """
    domain = domain_evolution(run.scene.commands)[1][0]
    stiffness = float(run.scene.mesh.stiffness[0])
    shape = stiffness * (run.displacement[:, 1] - run.displacement[:, 0])
    place = 2.0 * stiffness * run.net_translation
    centre = stiffness * _actuation(run)[:, 0]
    ends = domain.vertices()[:, 0]
    corners = _box_corners(domain) * (-1.0, 1.0)
    right = float(corners[:, 0].max())
    used = slice(0, marks[-1] + 1)
    axis.plot(place[used], shape[used], "--", color="black", linewidth=1.3, zorder=3)
    letters: dict[tuple[float, float], str] = {}
    for letter, row in zip(_LETTERS, marks, strict=False):
        at = np.array([place[row], centre[row]])
        axis.fill(*(corners + at).T, facecolor="#00000008", edgecolor="#606060", linewidth=1.0, zorder=1)
        axis.plot([at[0]] * 2, at[1] + ends, color=_SECTION, linewidth=3.0, solid_capstyle="butt", zorder=2)
        axis.plot(at[0], shape[row], "o", color="black", markersize=5, zorder=4)
        key = (round(float(place[row]), 9), round(float(centre[row]), 9))
        letters[key] = f"{letters[key]}, {letter}" if key in letters else letter
    side = corners[corners[:, 0].argmax()]
    for at, text in letters.items():
        style: Any = {"textcoords": "offset points", "va": "center", "fontsize": 10, "zorder": 5}
        box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.5}
        axis.annotate(text, tuple(np.array(at) + side), (4, 0), bbox=box, **style)
    axis.set(aspect="equal", xlabel="net translation $2 k y$ [N]  (right: forward)", ylabel="shape $k z$ [N]")
    axis.set_title("sweeping process: $k L$ moves the box up and down, sideways it follows the point that it pushes")
    axis.set_xlim(right=float(place[used].max()) + 1.6 * right)


# Three contacts


def _draw_three(scene: Scene, run: Trajectory) -> Figure:
    """Lay out the page of three contacts."""
    from matplotlib import pyplot as plt

    shown = _distinct(_shown_waypoints(scene))
    columns = 2 if len(shown) == 4 else min(len(shown), 3)
    rows = -(-len(shown) // columns)
    size = (7.0, 6.8) if len(shown) == 1 else (4.2 * columns, 4.3 * rows + 0.6)
    figure, grid = plt.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")
    figure.suptitle(f"stasis domain: {scene.name}\n{_verdict([domain for _, domain in shown])}", fontsize=11)
    path = _section_path(scene, run.tension)[_last_period(run)]
    limits = _limits([domain.vertices() for _, domain in shown])
    for axis, (time_s, domain) in zip(grid.ravel(), shown, strict=False):
        draw_polygon(axis, domain, [f"contact {i}" for i in range(3)], len(shown) == 1)
        draw_path(axis, path)
        if len(shown) > 1:
            axis.set_title(f"t = {time_s:.3g} s")
            here = _section_path(scene, run.tension)[[_nearest(run, time_s)]]
            axis.plot(*here.T, "o", color="black", markersize=6, zorder=6)
        axis.set(xlim=limits[0], ylim=limits[1], xlabel=_label(scene, 0), ylabel=_label(scene, 1))
    for axis in grid.ravel()[len(shown) :]:
        axis.set_axis_off()
    return figure


def _distinct(shown: list[tuple[float, StasisDomain]]) -> list[tuple[float, StasisDomain]]:
    """Leave out domains that were there before."""
    found = {(d.forward.tobytes(), d.backward.tobytes()): (t, d) for t, d in reversed(shown)}
    return list(reversed(found.values()))


def _nearest(run: Trajectory, time_s: float) -> int:
    """Find the tick of the last period at which the drive is at `time_s`."""
    rows = _last_period(run)
    return int(rows[np.abs(run.time[rows] - run.time[rows[0]] - time_s).argmin()])


def _limits(polygons: Sequence[np.ndarray]) -> list[tuple[float, float]]:
    """Make limits of square axes around polygons, wide enough for labels outside them."""
    corners = np.concatenate(polygons)
    low, high = corners.min(axis=0), corners.max(axis=0)
    half = 1.0 * float((high - low).max()) or 1.0
    return [(float(middle) - half, float(middle) + half) for middle in (low + high) / 2.0]


def draw_polygon(axis: Axes, domain: StasisDomain, names: Sequence[str], large: bool = True) -> None:
    """Draw a domain of three contacts, each side coloured by the direction that it allows.

    Args:
        axis: where to; its limits are left to the caller.
        domain: of three contacts.
        names: what the three are called.
        large: whether there is room for large letters.
    """
    corners = domain.vertices()
    axis.set_aspect("equal")
    axis.locator_params(nbins=7)
    axis.axhline(0.0, color="#c8c8c8", linewidth=0.8, zorder=0)
    axis.axvline(0.0, color="#c8c8c8", linewidth=0.8, zorder=0)
    axis.fill(*corners.T, facecolor=_FACE, edgecolor=GREY, linewidth=1.0, zorder=1)
    if corners.shape[0] < 3:
        axis.plot(*corners.T, "o-", color=GREY, linewidth=2.0, zorder=2)
        return
    for facet, a, b in _sides(domain):
        color = FORWARD if facet.direction > 0 else BACK
        axis.plot(*np.array([a, b]).T, color=color, linewidth=5.0, solid_capstyle="round", zorder=2)
        out = facet.normal / np.abs(facet.normal).max()
        axis.annotate(
            f"{_TRANSLATION[facet.direction]}\n{names[facet.contact]}",
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


def _sides(domain: StasisDomain) -> Iterator[tuple[Facet, np.ndarray, np.ndarray]]:
    """Find the side that each facet of a polygon is: its ends, each of shape (2,) [N]."""
    corners = domain.vertices()
    following = np.roll(corners, -1, axis=0)
    for facet in domain.facets():
        bound = (domain.forward if facet.direction > 0 else domain.backward)[facet.contact]
        slack = bound - (corners + following) / 2.0 @ facet.normal
        side = int(slack.argmin())
        yield facet, corners[side], following[side]


def draw_box_in_space(axis: Axes3D, domain: StasisDomain) -> None:
    """Draw the box C of three spring forces and its section by the plane in which they balance.

    The section's sides are coloured by the direction that they allow: each lies in the face of the box whose normal is
    the contact that slides there.

    Args:
        axis: a three-dimensional one.
        domain: of three contacts.
    """
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    low, high = -domain.backward, domain.forward
    corners = np.array(list(itertools.product(*zip(low, high, strict=True))))
    edges = [(a, b) for a, b in itertools.combinations(corners, 2) if np.count_nonzero(a != b) == 1]
    axis.add_collection3d(Line3DCollection(edges, colors=GREY, linewidths=0.9))
    section = spring_force(domain.vertices())
    axis.add_collection3d(Poly3DCollection([section], facecolor=_SECTION, alpha=0.45, edgecolor="none"))
    for facet, a, b in _sides(domain):
        color = FORWARD if facet.direction > 0 else BACK
        axis.plot(*spring_force(np.array([a, b])).T, color=color, linewidth=3.5)
    axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axis.set(xlabel="$g_0$ [N]", ylabel="$g_1$ [N]", zlabel="$g_2$ [N]", aspect="equal")
    axis.locator_params(nbins=4)
    axis.grid(False)


def draw_path(axis: Axes, path: np.ndarray, arrows: int = 6) -> None:
    """Draw a path with arrows along it, its start a dot.

    Args:
        axis: where to.
        path: shape (T, 2).
        arrows: how many.
    """
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


# More contacts


def _draw_many(scene: Scene, run: Trajectory) -> Figure:
    """Lay out the page of four contacts and more: two projections and the range of each section."""
    from matplotlib import pyplot as plt

    shown = _distinct(_shown_waypoints(scene))
    path = _section_path(scene, run.tension)[_last_period(run)]
    first, which_first = ((0, 1), "the first two sections")
    if scene.mesh.segments:
        first, which_first = _between_parts(scene.mesh), "sections that part the body"
    pairs = list(dict.fromkeys([first, _liveliest(path)]))
    names = [f"onto_{i}" for i in range(len(pairs))]
    rows: list[Any] = [names, ["ranges"] * len(names)]
    figure, axes = plt.subplot_mosaic(
        rows,
        figsize=(5.6 * len(names) + 0.4, 9.0),
        height_ratios=[2, 1.2],
        layout="constrained",
    )
    figure.suptitle(f"stasis domain: {scene.name}\n{_verdict([domain for _, domain in shown])}", fontsize=11)
    for name, pair in zip(names, pairs, strict=True):
        _draw_projections(axes[name], scene, [domain for _, domain in shown], pair, path)
        which = which_first if pair == first else "the two that change most"
        others = f"\nat t = 0, grey: at {len(shown) - 1} other waypoints" if len(shown) > 1 else ""
        axes[name].set_title(f"projection onto {which}{others}")
    _draw_ranges(axes["ranges"], scene, path)
    return figure


def _between_parts(mesh: Body) -> tuple[int, int]:
    """Find the first two sections between contacts and segments; where there are fewer, thirds of the body."""
    inside = {i for s in mesh.segments for i in range(s.first, s.last)}
    between = [i for i in range(mesh.contacts - 1) if i not in inside]
    thirds = [mesh.contacts // 3 - 1, 2 * mesh.contacts // 3 - 1]
    first, second = (between + [i for i in thirds if i not in between])[:2]
    return min(first, second), max(first, second)


def _liveliest(path: np.ndarray) -> tuple[int, int]:
    """Find the two sections that change most; in a long body a quarter of it apart, where neighbours are all alike."""
    travel = np.ptp(path, axis=0)
    first = int(travel.argmax())
    apart = 1 if travel.size <= _MOST_BARS else travel.size // 4
    far = np.abs(np.arange(travel.size) - first) >= apart
    second = int(np.where(far, travel, -1.0).argmax())
    return min(first, second), max(first, second)


def _draw_projections(
    axis: Axes, scene: Scene, domains: Sequence[StasisDomain], pair: tuple[int, int], path: np.ndarray
) -> None:
    """Draw the projections of all domains shown, the first with its sides marked."""
    merged = [domain.merged(*pair) for domain in domains]
    bounds = [0, pair[0] + 1, pair[1] + 1, domains[0].contacts]
    groups = [f"contact {a}" if b - a == 1 else f"contacts {a}-{b - 1}" for a, b in itertools.pairwise(bounds)]
    if scene.mesh.segments:
        at = scene.mesh.position
        groups = [
            f"{at[a]:.3g} m" if b - a == 1 else f"{at[a]:.3g}-{at[b - 1]:.3g} m" for a, b in itertools.pairwise(bounds)
        ]
    for domain in merged[1:]:
        axis.fill(*domain.vertices().T, facecolor="none", edgecolor=GREY, linewidth=0.9, zorder=1)
    draw_polygon(axis, merged[0], groups)
    draw_path(axis, path[:, pair])
    limits = _limits([domain.vertices() for domain in merged])
    axis.set(xlim=limits[0], ylim=limits[1], xlabel=_label(scene, pair[0]), ylabel=_label(scene, pair[1]))


def _draw_ranges(axis: Axes, scene: Scene, path: np.ndarray) -> None:
    """Draw the range of each section, and the part of it that the run uses."""
    least, most = (
        np.array(side) for side in zip(*(d.ranges() for d in domain_evolution(scene.commands)[1]), strict=True)
    )
    _draw_bars(axis, least.min(axis=0), most.max(axis=0), 0.8, "what some state of stasis has", color=_FACE)
    edge = {"edgecolor": "#c83c3c", "linewidth": 1.5}
    label = "" if _is_constant(scene) else "whatever the friction commanded"
    _draw_bars(axis, least.max(axis=0), most.min(axis=0), 0.8, label, facecolor="none", **edge)
    _draw_bars(axis, path.min(axis=0), path.max(axis=0), 0.35, "what the last period has", color=TENSION)
    sections = np.arange(path.shape[1])
    axis.use_sticky_edges = False
    axis.margins(x=0.02, y=0.06)
    axis.axhline(0.0, color=GREY, linewidth=0.8)
    axis.set_xlabel("link" if _symbol(scene) == "T" else "section")
    if scene.mesh.segments:
        axis.set_xlabel("place along the body [m]")
    axis.set_ylabel(f"{_quantity(scene)} [N]\n(> 0: stretched)")
    axis.set_xticks(sections if sections.size <= 20 else [0, sections.size - 1])
    if scene.mesh.segments:
        ticks = np.unique(np.linspace(0, sections.size - 1, 9).round().astype(int))
        places = 0.5 * (scene.mesh.position[:-1] + scene.mesh.position[1:])
        axis.set_xticks(ticks, [f"{places[i]:.3g}" for i in ticks])
    axis.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, fontsize=8, frameon=False)


def _draw_bars(axis: Axes, low: np.ndarray, high: np.ndarray, width: float, label: str, **style: Any) -> None:
    """Draw a bar for each section, or a band when there are many."""
    sections = np.arange(low.size)
    if low.size <= _MOST_BARS:
        axis.bar(sections, high - low, width, low, label=label or None, **style)
    else:
        axis.fill_between(sections, low, high, label=label or None, **style)


def _draw_plane(scene: Scene, run: Trajectory) -> Figure:
    """Draw each contact's friction set and spring force, of at most nine contacts."""
    from matplotlib import pyplot as plt

    mesh, drive = scene.mesh, scene.commands
    count = min(mesh.contacts, 9)
    columns = min(count, 3)
    figure, axes = plt.subplots(
        -(-count // columns),
        columns,
        figsize=(4.2 * columns, 4.4 * -(-count // columns)),
        layout="constrained",
        squeeze=False,
    )
    figure.suptitle(
        f"{scene.name}: forces that the ground can bear at each contact, and the springs' force over the last period"
    )
    rows = _last_period(run)
    force = np.array([mesh.spring_force(t) for t in run.tension[rows]])
    slides = run.contact_state[rows] != 0
    friction = np.unique(drive.targets[:, 2 * mesh.springs :], axis=0).reshape(
        -1, mesh.contacts, max(len(scene.directions), 1)
    )
    for i, axis in enumerate(axes.flat):
        if i >= count:
            axis.set_axis_off()
            continue
        for mu in friction[:6, i]:
            outline = _friction_outline(mu, scene.directions)
            axis.fill(*outline.T, facecolor="#f2dcda", edgecolor="#c83c3c", linewidth=1.2, alpha=0.6)
        axis.plot(*force[:, i].T, color="black", linewidth=1.0)
        axis.plot(*np.where(slides[:, i, None], force[:, i], np.nan).T, color=FORWARD, linewidth=3.0)
        axis.set_title(f"contact {i}: green while it slides")
        axis.set_aspect("equal")
        axis.set_xlabel("$g_x$ [N]")
        axis.set_ylabel("$g_y$ [N]")
    return figure


def _friction_outline(mu: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Compute the boundary of a contact's friction set, closed, shape (V, 2) [N]."""
    if directions.shape[0] == 0:
        angle = np.linspace(0.0, 2.0 * np.pi, 181)
        return mu[0] * np.column_stack((np.cos(angle), np.sin(angle)))
    corners = corners_of(mu[None], directions)[0]
    return np.vstack((corners, corners[:1]))
