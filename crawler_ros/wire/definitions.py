"""Definitions and hashes of message types, as the ROS packages install them."""

from __future__ import annotations

import functools
import json
import os
import sys
from pathlib import Path


def find_ament_prefix() -> None:
    """Add this environment to AMENT_PREFIX_PATH where ROS is installed as wheels, which do not add themselves."""
    prefixes = [p for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    if sys.prefix not in prefixes and (not prefixes or (Path(sys.prefix) / "share" / "ament_index").is_dir()):
        os.environ["AMENT_PREFIX_PATH"] = os.pathsep.join([*prefixes, sys.prefix])


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
    """Read the definition of a message type, followed by the definitions of all types that it contains.

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
