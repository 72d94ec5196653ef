"""Assemble what links and segments have besides a stiffness: curves, limits, passive springs, hysteresis, backlash."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from ..arrays import frozen, spread
from ..body.body import Body
from ..body.curves import Bend, Curve, line, through
from ..errors import SceneError
from .link_parts import CurvePart, LinksPart, PassivePart, SegmentPart, TensionPart
from .parts import BodyPart, SceneParts, StartPart


def read_links(parts: BodyPart) -> tuple[tuple[tuple[int | str, int | str], ...] | None, Any]:
    """Read the ends and the stiffness of the links of a body.

    Args:
        parts: the body.

    Returns:
        The pair of ends that each link joins, None for the chain of neighbours; and the stiffness of each link, or of
        all, 1 where there is none, see `assemble_bends` [N/m].

    Raises:
        SceneError: if some entries of a list name their ends and some do not, or there are too few or too many for the
            chain of neighbours.
    """
    links = parts.links
    if not isinstance(links, tuple):
        return (None, 1.0) if links is None else (links.between, 1.0 if links.stiffness is None else links.stiffness)
    pairs = tuple(link.between for link in links if link.between)
    if pairs and len(pairs) < len(links):
        missing = next(i for i, link in enumerate(links) if not link.between)
        raise SceneError(
            f"body.links.{missing}.between: missing; give it for every link, or for none for the chain of neighbours"
        )
    if not pairs and len(links) != parts.gaps:
        raise SceneError(f"body.links: {len(links)} entries; the chain of neighbours has {parts.gaps} link(s)")
    return pairs or None, tuple(1.0 if link.stiffness is None else link.stiffness for link in links)


def assemble_bends(parts: SceneParts, body: Body) -> Body:
    """Bend the springs of a body as its parts demand.

    Args:
        parts: the parts of the scene.
        body: the body on a line with linear springs.

    Returns:
        The body; the same one if all its springs are linear.

    Raises:
        SceneError: if a spring has no stiffness at any length, or stops, hysteresis or backlash do not fit; the message
            names it.
    """
    forces, ahead = _forces_at_start(parts, body), _ahead_at_start(parts, body)
    if not parts.body.is_bent:
        return body
    bends = _bend_links(parts.body, body, forces, ahead)
    for place, part in enumerate(parts.body.segments):
        at = body.link_springs.size + place
        bends += _bend_segment(part, body, place, forces[at], ahead[at])
    bends.sort(key=lambda bend: bend.spring)
    stiffness = np.array(body.stiffness)
    for bend in bends:
        stiffness[bend.spring] = bend.stiffness
    return dataclasses.replace(body, stiffness=frozen(stiffness), bends=tuple(bends))


def _forces_at_start(parts: SceneParts, body: Body) -> list[tuple[float, ...]]:
    """Read the forces of the elements of hysteresis at the start: of each link, then of each segment [N]."""
    given = parts.start.hysteresis if isinstance(parts.start, StartPart) else None
    each = _list_parts(parts.body, body)
    if given is None:
        return [(0.0,) * len(part.hysteresis) for part in each]
    if len(given) != len(each):
        raise SceneError(f"start.hysteresis: {len(given)} list(s); give one for each of {len(each)} links and segments")
    for i, (forces, part) in enumerate(zip(given, each, strict=True)):
        if len(forces) != len(part.hysteresis):
            raise SceneError(
                f"start.hysteresis.{i}: {len(forces)} force(s); it must be one for each of {len(part.hysteresis)} "
                "element(s) of `hysteresis` there"
            )
        for k, (force, element) in enumerate(zip(forces, part.hysteresis, strict=True)):
            if not abs(force) <= element.yields_at:
                raise SceneError(
                    f"start.hysteresis.{i}.{k}: {force:g} N; it must be from {-element.yields_at:g} to "
                    f"{element.yields_at:g} N, where the element yields"
                )
    return list(given)


def _ahead_at_start(parts: SceneParts, body: Body) -> list[float]:
    """Read how far actuators are ahead of their commands at the start: each link [m], then each segment [1]."""
    given = parts.start.backlash if isinstance(parts.start, StartPart) else None
    each = _list_parts(parts.body, body)
    if given is None:
        return [0.0] * len(each)
    if len(given) != len(each):
        raise SceneError(f"start.backlash: {len(given)} number(s); give one for each of {len(each)} links and segments")
    for i, (ahead, part) in enumerate(zip(given, each, strict=True)):
        if not abs(ahead) <= 0.5 * part.backlash:
            raise SceneError(
                f"start.backlash.{i}: {ahead:g}; it must be from {-0.5 * part.backlash:g} to {0.5 * part.backlash:g}, "
                "half of the `backlash` there"
            )
    return list(given)


def _list_parts(parts: BodyPart, body: Body) -> list[Any]:
    """List the part of each link, then of each segment."""
    links, count = parts.links, body.link_springs.size
    each: list[Any] = [links] * count if isinstance(links, LinksPart) else list(links or ())
    return each + list(parts.segments)


def _bend_segment(part: SegmentPart, body: Body, place: int, forces: tuple[float, ...], ahead: float) -> list[Bend]:
    """Bend the elements of a segment, whose curves are over the strain."""
    if not part.is_bent:
        return []
    where, segment = f"body.segments.{place}", body.segments[place]
    passive = _passive(part.passive, where, None).stretched(segment.element)
    bends = []
    for spring in range(segment.springs.start, segment.springs.stop):
        if part.curve is not None:
            curve = _curve(part.curve).stretched(segment.element)
        else:
            curve = line(0.0 if part.stiffness is None else float(body.stiffness[spring]))
        sliders, slack = _sliders(part, segment.element, forces), (part.backlash, ahead)
        actuator, (backlash, first) = _actuator(curve, part.tension), (segment.element * way for way in slack)
        bends.append(_checked(Bend(spring, actuator, passive, sliders, backlash, first), where))
    return bends


def _bend_links(parts: BodyPart, body: Body, forces: list[tuple[float, ...]], ahead: list[float]) -> list[Bend]:
    bends = []
    for i, spring in enumerate(body.link_springs.tolist()):
        alike = isinstance(parts.links, LinksPart)
        link: Any = parts.links if alike else parts.links[i]  # type: ignore[index]
        if link.is_bent:
            where = "body.links" if alike else f"body.links.{i}"
            stiffness = 0.0 if link.stiffness is None else float(body.stiffness[spring])
            curve = line(stiffness) if link.curve is None else _curve(link.curve)
            actuator = _actuator(curve, link.tension)
            passive = _passive(link.passive, where, _touching(parts, body, spring))
            sliders = _sliders(link, 1.0, forces[i])
            bends.append(_checked(Bend(spring, actuator, passive, sliders, link.backlash, ahead[i]), where))
    return bends


def _sliders(part: Any, length: float, forces: tuple[float, ...]) -> tuple[tuple[float, float, float], ...]:
    """Build the elements of hysteresis of a spring, whose stiffness in a segment is a modulus over its length [m]."""
    given = zip(part.hysteresis, forces, strict=True)
    return tuple((element.stiffness / length, element.yields_at, force) for element, force in given)


def _checked(bend: Bend, where: str) -> Bend:
    if not bend.stiffness > 0.0:
        raise SceneError(f"{where}: its tension is the same at all lengths; a spring needs a stiffness > 0 somewhere")
    if bend.sliders and bend.is_flat_somewhere:
        raise SceneError(
            f"{where}.hysteresis: where the spring in parallel is slack or at a limit of `tension`, nothing but "
            "the elements would hold, which is not supported; give it a `passive` spring, too"
        )
    if bend.backlash and np.isfinite(bend.limits).any():
        raise SceneError(
            f"{where}.backlash: with limits of `tension` it is not supported, as recorded states do not tell whether "
            "an actuator within its slack is at a limit; leave one of them out"
        )
    return bend


def _curve(part: CurvePart) -> Curve:
    return through(part.elongation, part.tension)


def _actuator(curve: Curve, limits: TensionPart | float | None) -> Curve:
    if limits is None:
        return curve
    if isinstance(limits, float):
        return curve.clamped(-limits, limits)
    least = -np.inf if limits.least is None else limits.least
    return curve.clamped(least, np.inf if limits.most is None else limits.most)


def _passive(part: PassivePart | None, where: str, touching: float | str | None) -> Curve:
    """Build the curve of a passive spring and its stops; `touching` is where two contacts touch, or why they do not."""
    if part is None:
        return line(0.0)
    curve = line(part.stiffness or 0.0) if part.curve is None else _curve(part.curve)
    stops = part.stops
    if stops is None:
        return curve
    shortest = stops.shortest
    if shortest == "contact":
        if not isinstance(touching, float):
            raise SceneError(f"{where}.passive.stops.shortest: contact; {touching or 'only two contacts can touch'}")
        if stops.longest is not None and touching > stops.longest:
            raise SceneError(
                f"{where}.passive.stops.longest: {stops.longest:g} m; the contacts touch at {touching:g} m already"
            )
        shortest = touching
    for at, first, last in ((shortest, stops.stiffness, 0.0), (stops.longest, 0.0, stops.stiffness)):
        if at is not None:
            curve = curve + Curve(np.array([float(at)]), np.zeros(1), first, last)
    return curve


def _touching(parts: BodyPart, body: Body, spring: int) -> float | str:
    """Compute the elongation at which the two contacts of a spring touch [m], or the reason why there is none."""
    place = {int(contact): i for i, contact in enumerate(body.isolated)}
    a, b = (int(contact) for contact in body.ends[spring])
    if a not in place or b not in place:
        return "the link ends at a segment, which has no radius; give a number"
    if parts.radius is None:
        return "give `body.radius`, the radius of the contacts"
    radius = spread(parts.radius, len(parts.contacts), "body.radius", "contact")
    distance = float(body.position[b] - body.position[a])
    reach = float(radius[place[a]] + radius[place[b]])
    if reach > distance:
        return f"contacts {place[a]} and {place[b]}, {distance:g} m apart, overlap: their radii sum to {reach:g} m"
    return reach - distance
