"""Names of contacts and links, as commands, states and tables use them."""

from __future__ import annotations


def name_contacts(count: int) -> list[str]:
    """Name the isolated contacts.

    Args:
        count: number of contacts.

    Returns:
        contact_0, contact_1, ...
    """
    return [f"contact_{i}" for i in range(count)]


def name_links(count: int) -> list[str]:
    """Name the links.

    Args:
        count: number of links.

    Returns:
        link_0, link_1, ...
    """
    return [f"link_{i}" for i in range(count)]
