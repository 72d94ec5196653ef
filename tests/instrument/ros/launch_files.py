"""What a launch file would start: an interpreter of the few XML tags that ours use, without ROS's `launch`."""

from __future__ import annotations

import re
import shlex
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent.parent
FOLDER = ROOT / "launch"
PACKAGE = "crawler_ros"
_TAGS = {"launch", "arg", "include", "group", "node", "param"}
_ATTRIBUTES = {
    "launch": set(),
    "arg": {"name", "default", "description", "value"},
    "include": {"file"},
    "group": set(),
    "node": {"pkg", "exec", "namespace", "output", "args", "on_exit"},
    "param": {"name", "value", "type", "from"},
}


@dataclass(frozen=True)
class Started:
    """A process that a launch file starts; when one that `ends_all` has ended, launch interrupts all others."""

    package: str
    executable: str
    namespace: str
    parameters: dict[str, str]
    types: dict[str, str]
    arguments: list[str]
    ends_all: bool


def substitute(text: str, values: dict[str, str], file: Path) -> str:
    """Replace `$(var x)` and `$(dirname)`; what runs a command stays as it is."""
    text = text.replace("$(dirname)", str(file.parent))
    text = re.sub(r"\$\(var (\w+)\)", lambda m: values[m.group(1)], text)
    assert "$(" not in text.replace("$(command ", ""), text
    return text


def read(file: Path) -> ET.Element:
    """Parse a launch file; only known tags and attributes are let through."""
    root = ET.parse(file).getroot()
    assert root.tag == "launch"
    for element in root.iter():
        assert element.tag in _TAGS, element.tag
        assert set(element.attrib) <= _ATTRIBUTES[element.tag], element.attrib
    return root


def start(file: Path, values: dict[str, str] | None = None) -> list[Started]:
    """List the processes that a launch file starts.

    Args:
        file: the launch file.
        values: arguments given. As with ROS, what an include sets stays set behind it, but for the end of a group.

    Returns:
        Them in order.
    """
    return _run(read(file), {} if values is None else values, file)


def _run(element: ET.Element, values: dict[str, str], file: Path) -> list[Started]:
    started: list[Started] = []
    for child in element:
        if child.tag == "arg":
            values.setdefault(child.get("name"), substitute(child.get("default"), values, file))
        elif child.tag == "group":
            started += _run(child, dict(values), file)
        elif child.tag == "include":
            given = {a.get("name"): substitute(a.get("value"), values, file) for a in child}
            values |= given
            other = Path(substitute(child.get("file"), values, file))
            started += _run(read(other), values, other)
        elif child.tag == "node":
            given = [p for p in child.iter("param") if p.get("from") is None]
            parameters = {p.get("name"): substitute(p.get("value"), values, file) for p in given}
            types = {p.get("name"): p.get("type") for p in given}
            namespace = substitute(child.get("namespace", ""), values, file)
            executable = substitute(child.get("exec"), values, file)
            arguments = shlex.split(substitute(child.get("args", ""), values, file))
            ends_all = child.get("on_exit")
            assert ends_all in (None, "shutdown"), ends_all  # launch knows no other
            started.append(
                Started(child.get("pkg"), executable, namespace, parameters, types, arguments, ends_all is not None)
            )
    return started
