"""Names of contacts and links, as commands, states and tables use them."""

from __future__ import annotations

from .body import Body


def name_each(noun: str, count: int) -> list[str]:
    """Name the isolated contacts, the links, or the joints of a body that turns.

    Args:
        noun: contact, link or joint.
        count: how many there are.

    Returns:
        For example contact_0, contact_1, ...
    """
    return [f"{noun}_{i}" for i in range(count)]


def name_every_spring(body: Body) -> tuple[str, ...]:
    """Name all springs.

    Args:
        body: the body.

    Returns:
        One name per spring: "link_0", or "trunk/element_7" inside a segment; for a body that turns, then one per joint.
    """
    if body.turning is not None:
        return tuple(name_joints(body))
    names = dict(zip(body.link_springs.tolist(), name_each("link", body.link_springs.size), strict=True))
    for segment in body.segments:
        names |= {segment.first_spring + j: f"{segment.name}/element_{j}" for j in range(segment.elements)}
    return tuple(names[i] for i in range(body.springs))


def name_joints(body: Body) -> list[str]:
    """Name the joints.

    Args:
        body: the body.

    Returns:
        Each link, then each segment, or each joint of a body that turns.
    """
    joints = name_each("joint", body.lengths - body.springs) if body.turning is not None else []
    return name_each("link", body.link_springs.size) + joints + [segment.name for segment in body.segments]


def name_every_contact(body: Body) -> tuple[str, ...]:
    """Name all contacts, shown or not.

    Args:
        body: the body.

    Returns:
        One name per contact along the body: "contact_0", or "trunk/contact_7" inside a segment. A contact that parts
        share has the name of the first of these: isolated contacts, then segments.
    """
    names: dict[int, str] = {}
    for segment in reversed(body.segments):
        names |= {segment.first + j: f"{segment.name}/contact_{j}" for j in range(segment.elements + 1)}
    names |= zip(body.isolated.tolist(), name_each("contact", body.isolated.size), strict=True)
    return tuple(names[i] for i in range(body.contacts))
