"""Names of contacts and links, as commands, states and tables use them."""

from __future__ import annotations

from .body import Body


def name_contacts(count: int) -> list[str]:
    """Name the isolated contacts.

    Args:
        count: number of contacts.

    Returns:
        contact_0, contact_1, ...
    """
    return [f"contact_{i}" for i in range(count)]


def name_every_spring(body: Body) -> tuple[str, ...]:
    """Name all springs.

    Args:
        body: the body.

    Returns:
        One name per spring: "link_0", or "trunk/element_7" inside a segment; of a body that turns, then one per joint.
    """
    if body.turning is not None:
        return tuple(name_joints(body))
    names = dict(zip(body.link_springs.tolist(), name_links(body.link_springs.size), strict=True))
    for segment in body.segments:
        names |= {segment.first_spring + j: f"{segment.name}/element_{j}" for j in range(segment.elements)}
    return tuple(names[i] for i in range(body.springs))


def name_links(count: int) -> list[str]:
    """Name the links.

    Args:
        count: number of links.

    Returns:
        link_0, link_1, ...
    """
    return [f"link_{i}" for i in range(count)]


def name_turning_joints(count: int) -> list[str]:
    """Name the joints of a body that turns.

    Args:
        count: number of joints.

    Returns:
        joint_0, joint_1, ...
    """
    return [f"joint_{i}" for i in range(count)]


def name_joints(body: Body) -> list[str]:
    """Name the joints.

    Args:
        body: the body.

    Returns:
        Each link, then each segment, or each joint of a body that turns.
    """
    joints = name_turning_joints(body.lengths - body.springs) if body.turning is not None else []
    return name_links(body.link_springs.size) + joints + [segment.name for segment in body.segments]


def name_every_contact(body: Body) -> tuple[str, ...]:
    """Name all contacts, shown or not.

    Args:
        body: the body.

    Returns:
        One name per contact along the body: "contact_0", or "trunk/contact_7" inside a segment.
    """
    names = dict(zip(body.isolated.tolist(), name_contacts(body.isolated.size), strict=True))
    for segment in body.segments:
        names |= {segment.first + j: f"{segment.name}/contact_{j}" for j in range(segment.elements + 1)}
    return tuple(names[i] for i in range(body.contacts))
