"""The topics of a crawler in a recording: as the recording lists them, else by the namespace in their names.

A topic may have been remapped, by itself or with its namespace, so its name in a recording need not end with its name
in the table of topics. The simulator records both in the attachment `topics`; other recorders do not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from ..wire.topics import read_topics


@dataclass(frozen=True)
class Robot:
    """A crawler in a recording.

    Attributes:
        namespace: namespace of its node, as "/" or "/left".
        topics: names in the recording by names in the table of topics.
    """

    namespace: str
    topics: Mapping[str, str]

    def recorded(self, name: str) -> str:
        """Return the recorded name of a topic.

        Args:
            name: its name in the table of topics.

        Returns:
            Its recorded name; "" when this crawler had no such topic.
        """
        return self.topics.get(name, "")

    def meant(self, topic: str) -> str:
        """Return the name in the table of topics of a recorded topic.

        Args:
            topic: the recorded name.

        Returns:
            Its name in the table of topics; the recorded name when it does not belong to this crawler.
        """
        return self._meanings.get(topic, topic)

    @cached_property
    def _meanings(self) -> dict[str, str]:
        return {topic: name for name, topic in self.topics.items()}


def noted_robot(attachments: Mapping[str, Any]) -> Robot | None:
    """Read the crawler whose topics a recording lists.

    Args:
        attachments: attachments of the recording.

    Returns:
        The crawler; None when the recording lists none.
    """
    names, node = attachments.get("topics"), attachments.get("node")
    if not isinstance(names, dict) or not all(isinstance(name, str) for name in names.values()):
        return None
    return Robot(node.rpartition("/")[0] or "/" if isinstance(node, str) else "/", names)


def robot_in(namespace: str) -> Robot:
    """Build the crawler of a namespace whose topics are not remapped.

    Args:
        namespace: namespace of its node, as "/" or "/left".

    Returns:
        The crawler.
    """
    prefix = f"{namespace.rstrip('/')}/"
    return Robot(namespace, {name: name if name.startswith("/") else prefix + name for name in read_topics()})
