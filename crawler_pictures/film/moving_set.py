"""The sweeping process of two and three contacts: a set that moves, and the point that it pushes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crawler_model.theory.stasis import StasisDomain, holds_loads

from ..domain_many import sides_of
from ..domain_two import box_corners
from .film import Film

_MOST_SIDES = 6


@dataclass(frozen=True, eq=False)
class MovingSet:
    """The set and the point in each of F frames, in newtons.

    Attributes:
        title: what moves and what is pushed.
        labels: of both axes.
        outline: corners of the set, repeated where it has fewer than V, shape (F, V, 2).
        sides: ends of the K sides at which motion begins, NaN where there are fewer, shape (F, K, 2, 2).
        directions: 1 where the body moves forward at the side, -1 where it moves back, else 0, shape (F, K).
        point: shape (F, 2).
    """

    title: str
    labels: tuple[str, str]
    outline: np.ndarray
    sides: np.ndarray
    directions: np.ndarray
    point: np.ndarray


def moving_set(film: Film) -> MovingSet | None:
    """Compute the sweeping process of a chain of two or three contacts, with constant or commanded friction.

    The springs k (z - L) are at rest in the stasis domain, so that the stretch k z stays in the domain moved by k L.
    Three contacts: the polygon C_sh + k L and the point k z. Two contacts: also the translation is shown, as the box of
    both spring forces, turned by 45 degrees, with its section; the box moves up and down with k L, and to the right it
    moves with 2 k y, the translation of the point that it pushes. Source: [G] section 4, and `draw_sweeping`.

    Args:
        film: the film.

    Returns:
        The set, or None for other bodies, for bent springs, in which L does not move a set of constant shape, and where
        walls hold what friction does not.
    """
    n = len(film.names)
    if film.forward.shape[1] != n or n not in (2, 3) or film.scene.body.bends:
        return None
    if not holds_loads(film.forward, film.backward):
        return None
    stiffness = film.scene.body.stiffness
    stretch = stiffness * np.diff(film.displacement, axis=1)
    moved = stretch - film.tension
    bounds = np.hstack((film.forward, film.backward))
    different, which = np.unique(bounds, axis=0, return_inverse=True)
    domains = [StasisDomain(*np.split(row, 2)) for row in different]
    if n == 3:
        shapes = [_polygon(domain) for domain in domains]
        title = "sweeping process: the polygon moves with $kL$,\nits sides push the point"
        labels = ("stretch $k_0 z_0$ [N]", "stretch $k_1 z_1$ [N]")
        centre, point = moved, stretch
    else:
        shapes = [_box(domain) for domain in domains]
        title = "sweeping process: $kL$ moves the box up and down,\nits ends push the point; to the right is forward"
        labels = ("net translation $2 k y$ [N]", "stretch $k z$ [N]")
        along = 2.0 * stiffness * film.net_translation[:, None]
        centre, point = np.hstack((along, moved)), np.hstack((along, stretch))
    which = which.ravel()
    outline, sides, directions = (np.array([shape[k] for shape in shapes])[which] for k in range(3))
    return MovingSet(
        title, labels, outline + centre[:, None], sides + centre[:, None, None], directions.astype(np.int8), point
    )


def _polygon(domain: StasisDomain) -> tuple[np.ndarray, ...]:
    """Compute corners, sides and directions of a domain of three contacts."""
    corners = domain.vertices()
    outline = np.vstack((corners, np.repeat(corners[-1:], _MOST_SIDES - corners.shape[0], axis=0)))
    sides, directions = np.full((_MOST_SIDES, 2, 2), np.nan), np.zeros(_MOST_SIDES)
    if corners.shape[0] >= 3:
        for k, (facet, a, b) in enumerate(sides_of(domain)):
            sides[k], directions[k] = (a, b), facet.direction
    return outline, sides, directions


def _box(domain: StasisDomain) -> tuple[np.ndarray, ...]:
    """Compute the turned box of two contacts, mirrored as in `draw_sweeping`, and the halves of its section."""
    low, high = domain.vertices()[:, 0]
    middle = 0.5 * (low + high)
    sides = np.array([[[0.0, low], [0.0, middle]], [[0.0, middle], [0.0, high]]])
    directions = np.zeros(2)
    for facet in domain.facets():
        directions[int(facet.normal[0] > 0.0)] = facet.direction
    return box_corners(domain) * (-1.0, 1.0), sides, directions
