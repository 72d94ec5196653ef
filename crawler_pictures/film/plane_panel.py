"""The body in the plane, drawn from above as a panel of a film."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..colors import BACK, FORWARD, GREY, STICK
from ..friction_marks import WORDS, friction_strokes
from ..ground import draw_areas
from .camera import watch_plane
from .film import Film
from .panels import MOST_ARROWS, MOST_COILS, Rolling, chosen_contacts, chosen_springs, coils, rigid_springs

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

_DARK, _STUCK = "#202020", "#9a9a9a"


class PlanePanel:
    """The body in the plane from above: contacts, springs, the path of each contact and of their mean."""

    def __init__(self, axes: Axes, film: Film) -> None:
        """Draw what does not move, and create what does.

        Args:
            axes: axes of the panel.
            film: the film.
        """
        self._axes, self._body = axes, film.scene.body
        chosen = chosen_contacts(film)
        self._place, self._state = film.place[:, chosen], film.state[:, chosen]
        self._joints = chosen_springs(film, chosen)
        self.rolling: Rolling | None = None
        self._mean = film.net_translation + film.share @ film.rest
        box = axes.get_window_extent()
        low, high = watch_plane(self._place, box.width / box.height)
        self._reach = float((high - low).min())
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="$x$ [m]", ylabel="$y$ [m]")
        axes.grid(alpha=0.3)
        draw_areas(axes, film.scene)
        self._moved = film.moved[:, chosen]
        self._most = float(np.linalg.norm(self._moved, axis=2).max()) or 1.0
        for i in range(chosen.size if chosen.size <= MOST_ARROWS else 0):
            axes.plot(*self._place[:, i].T, color=STICK, linewidth=0.8, zorder=1)
        (self._trails,) = axes.plot([], [], color=GREY, linewidth=1.1, zorder=1.5)
        (self._path,) = axes.plot([], [], color=_DARK, linewidth=1.8, zorder=1.6)
        (self._links,) = axes.plot([], [], color=_DARK, linewidth=1.3, zorder=2)
        (self._rods,) = axes.plot([], [], color=_DARK, linewidth=3.5, zorder=2)
        self._rigid = rigid_springs(self._place, self._joints)
        turns = self._body.turning is not None and chosen.size <= MOST_ARROWS
        (self._strokes,) = axes.plot([], [], color=BACK, linewidth=1.8, zorder=2.5)
        size = float(np.clip(500.0 / chosen.size, 3.0, 14.0))
        self._dots = {
            state: axes.plot([], [], "o", color=color, markersize=size, markeredgecolor=_DARK, zorder=3)[0]
            for state, color in ((0, _STUCK), (1, FORWARD))
        }
        (self._middle,) = axes.plot([], [], "+", color=_DARK, markersize=11, markeredgewidth=2.0, zorder=3)
        self._arrows = axes.quiver(
            *np.zeros((4, chosen.size if chosen.size <= MOST_ARROWS else 0)),
            color=FORWARD,
            angles="xy",
            scale_units="xy",
            scale=1.0,
            width=0.006,
            minlength=0.0,
            zorder=4,
        )
        self.moving: list[Artist] = [
            self._trails,
            self._path,
            self._links,
            self._rods,
            self._strokes,
            *self._dots.values(),
            self._middle,
            self._arrows,
        ]
        title = "from above; contacts: grey stick, green slide, arrows along the motion; + mean of the contacts"
        short = f"from above; grey stick, green slide, arrows along the motion; + mean; {WORDS}"
        axes.set_title(short if turns else title, loc="left", fontsize=9 if turns else 10)

    def move(self, k: int) -> None:
        """Move everything to a frame.

        Args:
            k: its number.
        """
        place, slides = self._place[k], self._state[k] != 0
        start, end = place[self._joints[:, 0]], place[self._joints[:, 1]]
        width = 0.02 * self._reach
        teeth = 5 if start.shape[0] <= MOST_COILS else 0
        for line, which, count in ((self._links, ~self._rigid, teeth), (self._rods, self._rigid, 0)):
            line.set_data(*coils(start[which], end[which], width, np.zeros(int(which.sum())), count).T)
        self._dots[0].set_data(*place[~slides].T)
        self._dots[1].set_data(*place[slides].T)
        self._middle.set_data(*self._mean[k : k + 1].T)
        self._path.set_data(*self._mean[: k + 1].T)
        if place.shape[0] <= MOST_ARROWS:
            past = np.concatenate((self._place[: k + 1], np.full((1, place.shape[0], 2), np.nan)))
            self._trails.set_data(*past.transpose(1, 0, 2).reshape(-1, 2).T)
            arrow = self._moved[k] * slides[:, None] * (0.2 * self._reach / self._most)
            strokes = friction_strokes(self._body, place, 3.5 * width)
            self._strokes.set_data(*np.insert(strokes, 2, np.nan, axis=1).reshape(-1, 2).T)
            self._arrows.set_offsets(place)
            self._arrows.set_UVC(*arrow.T)
