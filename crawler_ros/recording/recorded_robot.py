"""Which recorded topic is which of a crawler's: as its recording notes it, else by the namespace that names begin with.

A topic may have been remapped, alone or with its namespace, so its name in a recording need not end with its name in
the table of topics. The simulator notes both in the attachment `topics`; other recorders do not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from ..wire import interface


@dataclass(frozen=True)
class Robot:
    """A crawler in a recording.

    Attributes:
        namespace: of its node, as "/" or "/left".
        topics: name in the table of topics to name in the recording.
    """

    namespace: str
    topics: Mapping[str, str]

    def recorded(self, name: str) -> str:
        """Tell what a topic is called in the recording.

        Args:
            name: in the table of topics.

        Returns:
            Its recorded name; "" when this crawler had no such topic.
        """
        return self.topics.get(name, "")

    def meant(self, topic: str) -> str:
        """Tell which topic a recorded one is.

        Args:
            topic: the recorded name.

        Returns:
            Its name in the table of topics; the recorded name when it is none of this crawler's.
        """
        return self._meanings.get(topic, topic)

    @cached_property
    def _meanings(self) -> dict[str, str]:
        return {topic: name for name, topic in self.topics.items()}


def noted_robot(attachments: Mapping[str, Any]) -> Robot | None:
    """Take the crawler whose topics a recording notes.

    Args:
        attachments: of the recording.

    Returns:
        The crawler; None when nothing is noted.
    """
    names, node = attachments.get("topics"), attachments.get("node")
    if not isinstance(names, dict) or not all(isinstance(name, str) for name in names.values()):
        return None
    return Robot(node.rpartition("/")[0] or "/" if isinstance(node, str) else "/", names)


def robot_in(namespace: str) -> Robot:
    """Make the crawler whose topics are not remapped.

    Args:
        namespace: of its node, as "/" or "/left".

    Returns:
        The crawler.
    """
    prefix = f"{namespace.rstrip('/')}/"
    return Robot(namespace, {name: name if name.startswith("/") else prefix + name for name in interface.topics()})
