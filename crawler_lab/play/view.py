"""What a page shows of a crawler: numbers for its pictures, and a sentence for what happens."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from crawler_model import Scene
from crawler_model.body.names import name_every_contact, name_every_spring
from crawler_model.motion.jump import Jump
from crawler_model.theory.stasis import Facet, StasisDomain, holds_loads, stasis_bounds
from crawler_model.theory.uniqueness import UNDETERMINED
from crawler_pictures.domain_many import sides_of
from crawler_pictures.ground import has_stasis_bounds, list_areas, list_sections, list_walls, local_bounds

from .sliders import plain_name

MOST_SHOWN = 200
"""Number of contacts that a page shows of a long body, evenly spaced."""
_MOST_NAMED = 4
_FAR = 1e4
_YIELDS = {-1: "slack", 1: "stalled"}


@dataclass(frozen=True, eq=False)
class Instant:
    """A crawler at an instant, simulated or measured.

    Attributes:
        displacement: x, shape (N,), in the plane (N, 2) [m].
        tension: of each spring, then of each joint, shape (S,), in the plane (S, 2) [N, N m].
        force: of the springs on each contact, shape (N,), in the plane (N, 2) [N].
        margins: distance of each from its nearest bound, shape (N,) [N]; NaN if unknown.
        state: of each contact, 1 slid forward (in the plane: slid), -1 back, 2 both, 0 held, shape (N,).
        target: the target in force, shape (S + 2 N,).
        actuation: L in force, shape (S,), in the plane (S, 2) [m].
    """

    displacement: np.ndarray
    tension: np.ndarray
    force: np.ndarray
    margins: np.ndarray
    state: np.ndarray
    target: np.ndarray
    actuation: np.ndarray


class View:
    """Describes a scene once, and its instants."""

    def __init__(self, scene: Scene) -> None:
        """Choose what is shown.

        Args:
            scene: the scene.
        """
        self.scene, body = scene, scene.body
        count = min(body.contacts, MOST_SHOWN)
        self.shown = np.unique(np.round(np.linspace(0, body.contacts - 1, count)).astype(np.int64))
        self._whole = count == body.contacts
        self._links = np.arange(body.springs if self._whole else 0)
        names = [name.replace("contact_", "").replace("/", " ") for name in name_every_contact(body)]
        alone = len({name.rpartition(" ")[0] for name in names}) == 1  # then the name of the segment tells nothing
        self._names = [name.rpartition(" ")[2] if alone else name for name in names]
        self._bounded = has_stasis_bounds(body)

    def describe_scene(self) -> dict[str, Any]:
        """Collect what does not change: names, the links, the ground."""
        scene, body = self.scene, self.scene.body
        joints = [] if body.turning is None else body.turning.joints.tolist()
        return {
            "name": scene.name,
            "planar": body.dimension == 2,
            "contacts": [self._names[i] for i in self.shown],
            "rest": body.position[self.shown].tolist(),
            "links": body.ends.tolist() if self._whole else [[i, i + 1] for i in range(self.shown.size - 1)],
            "link_names": [plain_name(name) for name in name_every_spring(body)[: self._links.size]],
            "joints": joints,
            "sections": [asdict(s) for s in list_sections(scene, -_FAR, _FAR)],
            "walls": [[wall.at, wall.stops == "forward"] for wall in list_walls(scene, -_FAR, _FAR)],
            "areas": [[a.corners.tolist(), a.color] for a in list_areas(scene, np.full(2, -_FAR), np.full(2, _FAR))],
            "middle": np.atleast_1d(body.share @ body.position).tolist(),
        }

    def describe(self, instant: Instant) -> dict[str, Any]:
        """Collect what the pictures of an instant show; numbers are not rounded.

        Args:
            instant: the instant.

        Returns:
            Plain data. For a chain `least` and `most` are the bounds of each tension while the others stay, and for two
            or three contacts `domain` holds the vertices of the stasis domain, and `sides` its sides at which motion
            begins: the direction, the contact that slides, and both ends. `lengths` are the rest lengths of springs.
        """
        body, n = self.scene.body, self.scene.body.contacts
        tension = instant.tension[: body.springs]
        size = np.linalg.norm(tension, axis=1) if tension.ndim == 2 else tension
        found = {
            "x": instant.displacement[self.shown].tolist(),
            "state": instant.state[self.shown].tolist(),
            "tension": size[self._links].tolist(),
            "yields": self._yields(instant).tolist(),
            "lengths": self._rest_lengths(instant).tolist(),
        }
        if self._bounded and self._whole:
            forward, backward = local_bounds(self.scene, instant.target, instant.displacement)
            least, most = stasis_bounds(tension, forward, backward)
            found |= {"least": least.tolist(), "most": most.tolist()}
            if n in (2, 3) and holds_loads(forward, backward):
                domain = StasisDomain(forward, backward)
                found["domain"] = domain.vertices().tolist()
                found["sides"] = [[f.direction, f.contact, a.tolist(), b.tolist()] for f, a, b in _sides(domain)]
        return found

    def _rest_lengths(self, instant: Instant) -> np.ndarray:
        """Compute the length of each drawn spring at which it carries no force, shape (S,) [m]."""
        body = self.scene.body
        gap = (body.position[body.ends[:, 1]] - body.position[body.ends[:, 0]])[self._links]
        actuation = instant.actuation[: body.springs][self._links]
        if body.turning is not None:
            return np.linalg.norm(gap, axis=1) + actuation
        return gap + actuation if body.dimension == 1 else np.linalg.norm(gap + actuation, axis=1)

    def _yields(self, instant: Instant) -> np.ndarray:
        """Find the springs beyond their limits of tension: -1 slack, 1 stalled, else 0."""
        body = self.scene.body
        if not self._whole or not body.limits.index.size:
            return np.zeros(0, np.int8)
        elongation = body.elongation(instant.displacement)
        return body.limits.find_all_states(elongation[None], instant.actuation[None])[0]

    def tell(self, instant: Instant, unique: bool = True, jumps: Sequence[Jump] = ()) -> str:
        """Write what happens, such as "foot 1 slides forward; 0 and 2 hold; margin 0.02 N".

        Args:
            instant: the instant.
            unique: whether the translation was determined.
            jumps: of contacts onto ground that holds less.

        Returns:
            The sentence.
        """
        words = {
            1: "slides" if self.scene.body.dimension == 2 else "slides forward",
            -1: "slides back",
            2: "slides to and fro",
        }
        parts = []
        for sign, verb in words.items():
            who = np.flatnonzero(instant.state == sign)
            if who.size:
                verb = verb if who.size == 1 else verb.replace("slides", "slide")
                parts.append(f"{'foot' if who.size == 1 else 'feet'} {self._list(who)} {verb}")
        held = np.flatnonzero((instant.state == 0) & np.isfinite(instant.margins))
        if held.size:
            subject = self._list(held) if parts else "all feet" if held.size > 1 else f"foot {self._list(held)}"
            nearest = held[np.argmin(instant.margins[held])]
            parts.append(f"{subject} hold{'s' * (held.size == 1)}")
            more = f" (foot {self._names[nearest]}, {self._side(instant, nearest)})" if held.size > 1 else ""
            margin, rounding = float(instant.margins[nearest]), 1e-12 * float(np.abs(instant.force).max())
            parts.append(f"margin {margin if margin > rounding else 0.0:.3g} N{more}")
        yields = self._yields(instant)
        names = name_every_spring(self.scene.body)
        parts += [f"{plain_name(names[k])} is {_YIELDS[int(yields[k])]}" for k in np.flatnonzero(yields)[:_MOST_NAMED]]
        for jump in jumps:
            buckles = jump.border is None and not self.scene.ground.lets_go
            why = "as the body buckles" if buckles else "onto ground that holds less"
            parts.append(f"foot {self._names[jump.contact]} jumps by {jump.distance:.3g} m {why}")
        if not unique:
            parts.append(UNDETERMINED)
        return "; ".join(parts) or "nothing moves"

    def _side(self, instant: Instant, contact: int) -> str:
        """Name the way in which a contact is nearest to sliding, which its nearest bound decides, not its force."""
        if self.scene.body.dimension == 2:
            return "nearest to sliding"
        forward, backward = local_bounds(self.scene, instant.target, instant.displacement)
        force = instant.force[contact]
        ahead = forward[contact] - force < force + backward[contact]
        return "nearest to sliding forward" if ahead else "nearest to sliding back"

    def _list(self, contacts: np.ndarray) -> str:
        """Write a few names, of neighbours the first and the last."""
        names: list[str] = []
        for run in np.split(contacts, np.flatnonzero(np.diff(contacts) > 1) + 1):
            own = [self._names[i] for i in run]
            names += [f"{own[0]} to {own[-1]}"] if len(own) > 2 else own
        if len(names) > _MOST_NAMED:
            return f"{', '.join(names[:_MOST_NAMED])} and others"
        return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _sides(domain: StasisDomain) -> Iterator[tuple[Facet, np.ndarray, np.ndarray]]:
    """Find the sides of a polygon, or the ends of an interval, at which motion begins, with both of their ends."""
    corners = domain.vertices()
    if corners.shape[1] == 1:
        ends = corners[[0, -1]]
        yield from ((facet, end, end) for facet in domain.facets() for end in ends[int(facet.normal[0] > 0.0)][None])
    elif corners.shape[0] > 2:
        yield from sides_of(domain)
