"""What msgs_config says of topics, services and parameters, turned into ROS 2 objects: the one place for types."""

from __future__ import annotations

import contextlib
import difflib
import functools
import importlib
import json
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
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


@dataclass(frozen=True)
class Parameter:
    """One row of msgs_config/simulator.yaml."""

    name: str
    type: str
    default: Any
    meaning: str
    range: tuple[float, float] | None = None
    choices: tuple[str, ...] = ()
    runtime: bool = False


def _read(name: str) -> Any:
    return yaml.safe_load((resources.files("msgs_config") / name).read_text(encoding="utf-8"))


@functools.cache
def topics() -> dict[str, Topic]:
    """Read the table of topics, by name."""
    table = _read("topics.yaml")
    rows = table["topics"].items()
    return {name: Topic(name=name, **{**row, "qos": table["qos"][row["qos"]]}) for name, row in rows}


@functools.cache
def services() -> dict[str, str]:
    """Read the table of services: name under the node, type."""
    return {name: row["type"] for name, row in _read("topics.yaml")["services"].items()}


@functools.cache
def parameters() -> dict[str, Parameter]:
    """Read the table of the simulator's parameters, by name."""
    found = {}
    for name, row in _read("simulator.yaml").items():
        bounds = tuple(row.pop("range")) if "range" in row else None
        found[name] = Parameter(name=name, range=bounds, choices=tuple(row.pop("choices", ())), **row)
    return found


def in_home(path: str) -> str:
    """Put the home folder for a leading `~`, which no shell does behind `:=`.

    Args:
        path: as it was given.

    Returns:
        The path.

    Raises:
        ValueError: when it begins with the home folder of nobody.
    """
    found = os.path.expanduser(path)
    if found.startswith("~"):
        raise ValueError(f"{path}: there is no user {path[1:].split('/')[0]!r}; a leading ~ stands for a home folder")
    return found


def find_ament_prefix() -> None:
    """Let the ament index be found where ROS came as wheels: they are no part of AMENT_PREFIX_PATH unless put there."""
    prefixes = [p for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    if sys.prefix not in prefixes and (not prefixes or (Path(sys.prefix) / "share" / "ament_index").is_dir()):
        os.environ["AMENT_PREFIX_PATH"] = os.pathsep.join([*prefixes, sys.prefix])


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
    """Say of a topic that cannot be opened which one it is; QoS that is overridden with no QoS, say."""
    try:
        yield
    except (RuntimeError, ValueError) as error:
        raise ValueError(f"topic {topic.name}: {error}") from error


def qos_in_use(topic: Topic, end: Any) -> Topic:
    """Put into a topic's row the QoS that its publisher or subscription has, overrides and all.

    Args:
        topic: its row in the table of topics.
        end: rclpy's publisher or subscription.

    Returns:
        The row.
    """
    profile = end.qos_profile
    names = {key: getattr(profile, key).name.lower() for key in ("history", "reliability", "durability")}
    return replace(topic, qos={**names, "depth": profile.depth})


def offered_qos(topic: Topic) -> list[dict[str, Any]]:
    """Lay a topic's QoS out as rosbag2's metadata, version 9, has it."""
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


def _share(package: str) -> Path:
    from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

    find_ament_prefix()
    try:
        return Path(get_package_share_directory(package))
    except PackageNotFoundError:
        raise FileNotFoundError(
            f"AMENT_PREFIX_PATH={os.environ['AMENT_PREFIX_PATH']}: the ROS package {package} is under none of these "
            "folders; a recording holds its message definitions; source the setup.bash of your ROS 2 installation"
        ) from None


@functools.cache
def message_definition(type_name: str) -> str:
    """Read the definition of a message type and, behind it, of every type that it contains.

    Args:
        type_name: as in "sensor_msgs/msg/JointState".

    Returns:
        The text that a recording's ros2msg schema holds.

    Raises:
        FileNotFoundError: when the package of a type is not found through AMENT_PREFIX_PATH.
    """
    own: dict[str, str] = {}
    waiting = [type_name]
    while waiting:
        current = waiting.pop(0)
        if current in own:
            continue
        package, kind, name = current.split("/")
        own[current] = (_share(package) / kind / f"{name}.msg").read_text(encoding="utf-8")
        for line in own[current].splitlines():
            word = line.split("#")[0].split()
            if len(word) < 2 or "=" in word[1]:
                continue
            field = word[0].split("[")[0].split("<")[0]
            if field[:1].isupper() and field != "Header":
                field = f"{package}/{field}"
            elif field == "Header":
                field = "std_msgs/Header"
            if "/" in field:
                parts = field.split("/")
                waiting.append(f"{parts[0]}/msg/{parts[-1]}")
    first, *rest = own
    pieces = [own[first]]
    for name in rest:
        package, _, short = name.split("/")
        pieces.append(f"{'=' * 80}\nMSG: {package}/{short}\n{own[name]}")
    return "\n".join(pieces)


@functools.cache
def type_hash(type_name: str) -> str:
    """Read the RIHS01 hash of a message type."""
    package, kind, name = type_name.split("/")
    described = json.loads((_share(package) / kind / f"{name}.json").read_text(encoding="utf-8"))
    hashes = {entry["type_name"]: entry["hash_string"] for entry in described["type_hashes"]}
    return str(hashes[type_name])


def _as_meant(node: Any, silent: bool) -> None:
    """Take whole numbers for doubles, and YAML's `off` for the word; name parameters that there are not."""
    from rclpy.parameter import Parameter as RosParameter

    given = getattr(node, "_parameter_overrides", {})
    for name, override in list(given.items()):
        row = parameters().get(name)
        if row is None:
            if not silent and not name.startswith(("qos_overrides", "use_sim_time", "start_type_description_service")):
                near = difflib.get_close_matches(name, parameters(), n=1, cutoff=0.6)
                hint = f"the nearest is {near[0]!r}" if near else f"there are {', '.join(parameters())}"
                node.get_logger().warning(f"there is no parameter {name!r}; {hint}")
        elif row.type == "double" and type(override.value) is int:
            given[name] = RosParameter(name, RosParameter.Type.DOUBLE, float(override.value))
        elif row.type == "string" and override.value is False:
            given[name] = RosParameter(name, RosParameter.Type.STRING, "off")


def declare_parameters(node: Any, silent: bool = False) -> dict[str, Any]:
    """Declare the simulator's parameters on a node, with type, range, description and read-only flag.

    Args:
        node: an rclpy node.
        silent: whether unknown parameters are passed over without a warning.

    Returns:
        The values, by name.

    Raises:
        ValueError: when a value has the wrong type or is none of the choices.
    """
    from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
    from rclpy.exceptions import InvalidParameterTypeException
    from rclpy.parameter import Parameter as RosParameter

    kinds = {
        "string": RosParameter.Type.STRING,
        "double": RosParameter.Type.DOUBLE,
        "bool": RosParameter.Type.BOOL,
    }
    values = {}
    _as_meant(node, silent)
    for name, row in parameters().items():
        descriptor = ParameterDescriptor(
            name=name, type=kinds[row.type].value, description=row.meaning, read_only=not row.runtime
        )
        if row.range is not None:
            descriptor.floating_point_range = [FloatingPointRange(from_value=row.range[0], to_value=row.range[1])]
        if row.choices:
            descriptor.additional_constraints = f"one of {', '.join(row.choices)}"
        try:
            values[name] = node.declare_parameter(name, row.default, descriptor).value
        except InvalidParameterTypeException as error:
            kind = {"double": "a number", "bool": "true or false", "string": "text"}[row.type]
            raise ValueError(f"parameter {name} takes {kind} ({row.meaning}) {error}") from None
        if row.choices and values[name] not in row.choices:
            raise ValueError(f"parameter {name}: {values[name]!r}; it must be one of {', '.join(row.choices)}")
    return values
