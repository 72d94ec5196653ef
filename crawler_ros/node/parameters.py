"""The parameters of the simulator, from msgs_config/simulator.yaml to declarations on a node."""

from __future__ import annotations

import contextlib
import functools
import os
from dataclasses import dataclass
from typing import Any

from ..wire.topics import read_table
from .life.overrides import describe_unknown, refuse_unknown
from .life.scheduling import check_priority

_KINDS = {"double": "a number", "integer": "a whole number", "bool": "true or false", "string": "text"}


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


@functools.cache
def read_parameters() -> dict[str, Parameter]:
    """Read the table of the simulator's parameters, by name."""
    found = {}
    for name, row in read_table("simulator.yaml").items():
        bounds = tuple(row.pop("range")) if "range" in row else None
        found[name] = Parameter(name=name, range=bounds, choices=tuple(row.pop("choices", ())), **row)
    return found


def expand_home(path: str) -> str:
    """Expand a leading `~`, which no shell does behind `:=`.

    Args:
        path: a path as entered by the user.

    Returns:
        The path with the home folder in place of the `~`.

    Raises:
        ValueError: when the user named after the `~` does not exist.
    """
    found = os.path.expanduser(path)
    if found.startswith("~"):
        raise ValueError(f"{path}: there is no user {path[1:].split('/')[0]!r}; a leading ~ stands for a home folder")
    return found


def _normalise_overrides(node: Any) -> None:
    """Convert whole numbers and texts such as 1e3 to doubles, and YAML's `off` to text."""
    from rclpy.parameter import Parameter as RosParameter

    overrides = getattr(node, "_parameter_overrides", {})
    for name, override in list(overrides.items()):
        row = read_parameters().get(name)
        if row is None:
            continue
        if row.type == "double" and type(override.value) in (int, str):
            with contextlib.suppress(ValueError):  # else its declaration refuses it
                overrides[name] = RosParameter(name, RosParameter.Type.DOUBLE, float(override.value))
        elif row.type == "string" and override.value is False:
            overrides[name] = RosParameter(name, RosParameter.Type.STRING, "off")


def warn_of_unused_qos(node: Any) -> None:
    """Warn about parameters of the quality of service that belong to no topic.

    Args:
        node: an rclpy node with all its topics open, which have declared theirs.
    """
    known = [name for name in node._parameters if name.startswith("qos_overrides")]
    for name in getattr(node, "_parameter_overrides", {}):
        if name.startswith("qos_overrides") and name not in known:
            node.get_logger().warning(describe_unknown(name, known))


def declare_parameters(node: Any) -> dict[str, Any]:
    """Declare the simulator's parameters on a node, with type, range, description and read-only flag.

    Args:
        node: an rclpy node.

    Returns:
        The values, by name.

    Raises:
        ValueError: when a parameter is unknown, or a value has the wrong type, is not one of the choices or is not
            permitted.
    """
    from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
    from rclpy.exceptions import InvalidParameterTypeException
    from rclpy.parameter import Parameter as RosParameter

    kinds = {
        "string": RosParameter.Type.STRING,
        "double": RosParameter.Type.DOUBLE,
        "integer": RosParameter.Type.INTEGER,
        "bool": RosParameter.Type.BOOL,
    }
    values = {}
    refuse_unknown(node, read_parameters())
    _normalise_overrides(node)
    for name, row in read_parameters().items():
        descriptor = ParameterDescriptor(
            name=name, type=kinds[row.type].value, description=row.meaning, read_only=not row.runtime
        )
        if row.range is not None and row.type == "integer":
            descriptor.integer_range = [IntegerRange(from_value=row.range[0], to_value=row.range[1], step=1)]
        elif row.range is not None:
            descriptor.floating_point_range = [FloatingPointRange(from_value=row.range[0], to_value=row.range[1])]
        if row.choices:
            descriptor.additional_constraints = f"one of {', '.join(row.choices)}"
        try:
            values[name] = node.declare_parameter(name, row.default, descriptor).value
        except InvalidParameterTypeException as error:
            raise ValueError(f"parameter {name} takes {_KINDS[row.type]} ({row.meaning}) {error}") from None
        if row.choices and values[name] not in row.choices:
            raise ValueError(f"parameter {name}: {values[name]!r}; it must be one of {', '.join(row.choices)}")
        if name == "frame_id" and not values[name].strip():
            raise ValueError(f"parameter frame_id: {values[name]!r}; it must be the name of a frame")
    check_priority(values)
    return values
