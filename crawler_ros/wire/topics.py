"""The topics and services of msgs_config/topics.yaml as ROS 2 objects: types, QoS, publishers and subscriptions."""

from __future__ import annotations

import contextlib
import functools
import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib import resources
from typing import Any

import yaml


@dataclass(frozen=True)
class Topic:
    """One row of msgs_config/topics.yaml."""

    name: str
    type: str
    direction: str
    qos: dict[str, Any]
    meaning: str
    unit: str = ""
    frame: str = ""


def read_table(name: str) -> Any:
    """Read a YAML file of msgs_config, which is parsed in C where possible: a tenth of the time.

    Args:
        name: of the file.

    Returns:
        Its contents.
    """
    text = (resources.files("msgs_config") / name).read_text(encoding="utf-8")
    return yaml.load(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))


@functools.cache
def read_topics() -> dict[str, Topic]:
    """Read the table of topics, by name."""
    table = read_table("topics.yaml")
    rows = table["topics"].items()
    return {name: Topic(name=name, **{**row, "qos": table["qos"][row["qos"]]}) for name, row in rows}


@functools.cache
def read_services() -> dict[str, str]:
    """Read the table of services: name under the node, type."""
    return {name: row["type"] for name, row in read_table("topics.yaml")["services"].items()}


def message_class(type_name: str) -> Any:
    """Import the class of a message or service type.

    Args:
        type_name: as in "sensor_msgs/msg/JointState".

    Returns:
        The class that rclpy takes.
    """
    package, kind, name = type_name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), name)


def qos_profile(topic: Topic) -> Any:
    """Build the rclpy QoSProfile of a topic."""
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        history=HistoryPolicy[topic.qos["history"].upper()],
        depth=topic.qos["depth"],
        reliability=ReliabilityPolicy[topic.qos["reliability"].upper()],
        durability=DurabilityPolicy[topic.qos["durability"].upper()],
    )


def open_publisher(node: Any, topic: Topic) -> Any:
    """Create the publisher of a topic; parameters `qos_overrides.TOPIC.publisher.*` change its QoS.

    Args:
        node: an rclpy node.
        topic: its row in the table of topics.

    Returns:
        rclpy's publisher.
    """
    from rclpy.qos_overriding_options import QoSOverridingOptions

    options = QoSOverridingOptions.with_default_policies()
    kind = message_class(topic.type)
    with _named(topic):
        return node.create_publisher(kind, topic.name, qos_profile(topic), qos_overriding_options=options)


def open_subscription(node: Any, topic: Topic, receive: Callable[[bytes], None]) -> Any:
    """Create a subscription to the bytes of a topic; `qos_overrides.TOPIC.subscription.*` change its QoS.

    Args:
        node: an rclpy node.
        topic: its row in the table of topics.
        receive: called with the CDR bytes of each message.

    Returns:
        rclpy's subscription.
    """
    from rclpy.qos_overriding_options import QoSOverridingOptions

    options = QoSOverridingOptions.with_default_policies()
    kind = message_class(topic.type)
    with _named(topic):
        return node.create_subscription(
            kind, topic.name, receive, qos_profile(topic), raw=True, qos_overriding_options=options
        )


@contextlib.contextmanager
def _named(topic: Topic) -> Iterator[None]:
    """Name the topic in an error raised while opening it, such as one about an invalid QoS override."""
    try:
        yield
    except (RuntimeError, ValueError) as error:
        raise ValueError(f"topic {topic.name}: {error}") from error


def qos_in_use(topic: Topic, end: Any) -> Topic:
    """Replace the QoS in a topic's row by the QoS of its publisher or subscription, overrides included.

    Args:
        topic: its row in the table of topics.
        end: rclpy's publisher or subscription.

    Returns:
        The row with the QoS in use.
    """
    profile = end.qos_profile
    names = {key: getattr(profile, key).name.lower() for key in ("history", "reliability", "durability")}
    return replace(topic, qos={**names, "depth": profile.depth})


def offered_qos(topic: Topic) -> list[dict[str, Any]]:
    """Build a topic's QoS entry of rosbag2 metadata, version 9."""
    forever = {"sec": 9223372036, "nsec": 854775807}
    return [
        {
            "history": topic.qos["history"],
            "depth": topic.qos["depth"],
            "reliability": topic.qos["reliability"],
            "durability": topic.qos["durability"],
            "deadline": dict(forever),
            "lifespan": dict(forever),
            "liveliness": "automatic",
            "liveliness_lease_duration": dict(forever),
            "avoid_ros_namespace_conventions": False,
        }
    ]
