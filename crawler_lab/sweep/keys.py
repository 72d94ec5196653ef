"""Dotted keys of the numbers of a scene, and how a document is changed at them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from crawler_model.body.turning import SIDES
from crawler_model.errors import SceneError
from crawler_model.scene.scene import Scene
from crawler_model.scene.validate import known_keys, propose_key

KeyPath = tuple[str | int, ...]
"""The way to a number in a document: keys of mappings, places in lists, and `EVERY`."""
EVERY = "*"
"""The step to all entries of a list."""
_OPTIONAL = (
    *("period", "mean", "samples", "accuracy", "elements", "shown", "tolerance", "isotropic", "slope"),
    *("tension", "least", "most", "angle"),
)
"""Numbers that a document may omit."""
_ZERO = (("loads",), ("body", "weights"))
"""Numbers, one for all or one each, that are 0 where a document omits them."""


def key_steps(key: str) -> list[str]:
    """Split a dotted key; `loads[2]` is `loads.2`.

    Args:
        key: the key.

    Returns:
        Its steps.
    """
    return re.sub(r"\[(\d+)\]", r".\1", key).split(".")


def is_friction(steps: Sequence[str | int]) -> bool:
    """Determine whether a key names friction that commands of friction replace.

    Args:
        steps: the steps of the key.

    Returns:
        Whether it does: not what elongations add, nor the factors of the ground, nor the angle of a frame.
    """
    own = steps[0] == "friction" or (steps[0] == "body" and "friction" in steps)
    return own and "angle" not in steps and "with_elongation" not in steps


def put(node: Any, path: KeyPath, value: float) -> Any:
    """Set a number in a copy of a document.

    Args:
        node: the document, or a part of it.
        path: the way to the number from there.
        value: the number [unit of the key].

    Returns:
        The copy; only the containers on the path are copied.
    """
    if path[0] == EVERY:
        return [put(part, path[1:], value) for part in node]
    copy = node.copy()
    copy[path[0]] = value if len(path) == 1 else put(node[path[0]], path[1:], value)
    return copy


def read(node: Any, path: KeyPath, key: str) -> Any:
    """Read what a document has at a path.

    Args:
        node: the document, or a part of it.
        path: the way from there.
        key: the key, for the message.

    Returns:
        The number, or None where the document omits it.

    Raises:
        SceneError: if the entries that a key stands for differ.
    """
    for depth, step in enumerate(path):
        if step == EVERY:
            found = [read(part, path[depth + 1 :], key) for part in node]
            if any(value != found[0] for value in found):
                raise SceneError(f"vary: {key}: the links differ, so no one number stands for all: {found[:4]}")
            return found[0]
        node = node.get(step) if isinstance(node, dict) else node[step]
    return node


def overlap(path: KeyPath, other: KeyPath) -> bool:
    """Return whether two paths set the same number.

    Args:
        path: a path.
        other: another path.

    Returns:
        Whether one leads to, or through, the place to which the other leads.
    """
    return all(a == b or EVERY in (a, b) for a, b in zip(path, other, strict=False))


def make_room(scene: Scene, document: dict[str, Any], path: KeyPath) -> None:
    """Write a document such that a path leads to a number.

    Friction takes the form that the key names, limits of tension become a mapping, elements that follow from a varied
    accuracy go, and one number for all becomes a list.

    Args:
        scene: the scene of the document.
        document: its document; it changes.
        path: the path, from `find_path`.
    """
    node: Any = document
    for known in _ZERO:
        if path[: len(known)] == known:
            (document if len(known) == 1 else document[known[0]]).setdefault(known[-1], 0.0)
    if path[0] == "ground":
        document.setdefault("ground", {})
    if "tension" in path[:-1]:
        _name_limits(document, path[: path.index("tension")])
    sides = SIDES if scene.body.turning is not None else ("forward", "backward")
    for step in path[:-1]:
        if step in (*SIDES, "isotropic", EVERY):
            break
        if not isinstance(node[step], (dict, list)):
            break
        node = node[step]
        if isinstance(node, dict):
            # what elongations add has sides of its own
            side = next((s for s in path if s in (*sides, "isotropic", "with_elongation")), None)
            if side in sides and "isotropic" in node:
                node.update(dict.fromkeys(sides, node.pop("isotropic")))
            elif side == "isotropic" and side not in node and "forward" in node:
                node["isotropic"] = node["forward"]
                for each in sides:
                    del node[each]
    if path[-1] == "accuracy" and scene.parts.body.segments[int(path[2])].elements is None:
        node.pop("elements", None)
    if isinstance(path[-1], int):
        _spread(scene, document, path[:-1])


def _name_limits(node: Any, path: KeyPath) -> None:
    """Write the limits of the tension of parts as mappings."""
    for depth, step in enumerate(path):
        if step == EVERY:
            for part in node:
                _name_limits(part, path[depth + 1 :])
            return
        node = node[step]
    node["tension"] = _limits_of(node.get("tension"))


def _limits_of(tension: Any) -> Any:
    """Write limits of tension as a mapping: none, and one number for both directions."""
    if isinstance(tension, float):
        return {"least": -tension, "most": tension}
    return {} if tension is None else tension


def _spread(scene: Scene, document: dict[str, Any], path: KeyPath) -> None:
    """Write one number for all as a list, so that a key can name an entry."""
    node: Any = document
    for step in path[:-1]:
        node = node[step]
    if isinstance(node[path[-1]], (int, float)):
        node[path[-1]] = [node[path[-1]]] * _entries(scene, path)


def _entries(scene: Scene, path: KeyPath) -> int:
    """Count the entries of a list that a document may write as one number; 0 for other numbers."""
    body = scene.body
    if path in _ZERO:
        return int(body.isolated.size) + len(body.segments)
    if path[0] == "friction" and path[-1] in (*SIDES, "isotropic"):
        return int(body.isolated.size)
    if path == ("body", "joints", "stiffness") and body.turning is not None:
        return int(body.turning.joint_stiffness.size)
    return int(body.link_springs.size) if path == ("body", "links", "stiffness") else 0


def find_path(scene: Scene, key: str) -> KeyPath:
    """Resolve a dotted key in the document of a scene.

    Args:
        scene: the scene.
        key: the key; in a list of links, one without a number stands for all of them.

    Returns:
        The path to the number.

    Raises:
        SceneError: if the scene has no such key, or if it does not hold a number.
    """
    node: Any = scene.document()
    sides = SIDES if scene.body.turning is not None else ("forward", "backward")
    if scene.dimension == 1:
        node["body"].setdefault("weights", 0.0)
        node = {"loads": 0.0, "ground": {}} | node
    path: list[str | int] = []
    steps = key_steps(key)
    for depth, step in enumerate(steps):
        last = depth == len(steps) - 1
        if isinstance(node, list):
            names = [part.get("name") if isinstance(part, dict) else None for part in node]
            if step in names:
                path.append(names.index(step))
            elif step.isdecimal() and int(step) < len(node):
                path.append(int(step))
            elif path == ["body", "links"] and node and not step.isdecimal():
                each = [find_path(scene, ".".join(["body.links", str(i), *steps[depth:]])) for i in range(len(node))]
                return ("body", "links", EVERY, *each[0][3:])
            elif step.isdecimal():
                raise _beyond(key, path, len(node))
            else:
                raise _unknown(scene, key)
        elif isinstance(node, dict):
            isotropic = step in sides and "isotropic" in node
            optional = step in _OPTIONAL and step in known_keys([str(p) for p in path])
            if step not in node and not (isotropic or (optional and (last or step == "tension"))):
                raise _unknown(scene, key)
            path.append(step)
            if isotropic and step not in node:
                node = {step: node["isotropic"]}
        elif isinstance(node, float) and step.isdecimal() and (count := _entries(scene, tuple(path))):
            if int(step) >= count:
                raise _beyond(key, path, count)
            path.append(int(step))
            continue
        else:
            raise _unknown(scene, key)
        node = node.get(step) if isinstance(node, dict) else node[path[-1]]
        if path[-1] == "tension":
            node = None if last else _limits_of(node)
    if isinstance(node, (dict, str)) or (isinstance(node, list) and not _is_list_of_numbers(node)):
        found = (
            repr(node) if isinstance(node, str) else "a part with more keys" if isinstance(node, dict) else "a table"
        )
        near = [k for k in _keys(scene.document()) if k.startswith(key + ".")][:4]
        raise SceneError(f"vary: {key}: {found} is not a number{'; vary ' + ', '.join(near) if near else ''}")
    return tuple(path)


def _is_list_of_numbers(node: list[Any]) -> bool:
    return all(isinstance(v, (int, float)) for v in node)


def _keys(node: Any, before: str = "") -> Iterator[str]:
    """List the dotted keys of all numbers, and of lists of them."""
    items: Any = ()
    if isinstance(node, dict):
        items = node.items()
    elif isinstance(node, list):
        items = ((part.get("name", i) if isinstance(part, dict) else i, part) for i, part in enumerate(node))
    for step, part in items:
        key = f"{before}{step}"
        if isinstance(part, (int, float)) or (isinstance(part, list) and _is_list_of_numbers(part)):
            yield key
        if isinstance(part, (dict, list)):
            yield from _keys(part, f"{key}.")


def _beyond(key: str, path: Sequence[str | int], count: int) -> SceneError:
    entries = "entry" if count == 1 else "entries"
    return SceneError(f"vary: {key}: {'.'.join(map(str, path))} has {count} {entries}, numbered from 0")


def _unknown(scene: Scene, key: str) -> SceneError:
    keys = list(_keys(scene.document()))
    sides = ("forward", "backward")
    keys += [k.removesuffix("isotropic") + side for k in keys if k.endswith("isotropic") for side in sides]
    return SceneError(f"vary: {key}: unknown key; {propose_key(key, keys)}")


def expand_keys(scene: Scene, keys: Sequence[str], caller: str) -> tuple[str, ...]:
    """List the numbers that keys name.

    Args:
        scene: the scene.
        keys: dotted keys as for `vary`; a key that names a table or a list counts once for each number in it, row by
            row.
        caller: name of the function, for error messages.

    Returns:
        Names such as `drive.actuation[3][1]`.

    Raises:
        SceneError: if a key is unknown, names no number, or is given twice.
    """
    if isinstance(keys, str) or not keys:
        raise SceneError(f"{caller}: {keys!r}; it must be a list of at least one key, for example ['friction.forward']")
    names: list[str] = []
    document = scene.document()
    for key in keys:
        if not isinstance(key, str):
            raise SceneError(f"{caller}: {key!r}; a key is a string, for example friction.forward")
        node = _look_up(document, key_steps(key))
        names.extend(_names_below(node, key) if isinstance(node, list) else [key])
    for name, times in Counter(names).items():
        if times > 1:
            raise SceneError(f"{caller}: {name} is named twice")
    return tuple(names)


def check_form(scene: Scene, names: Sequence[str], caller: str) -> None:
    """Check that no key is `isotropic` where the scene gives friction by direction: no number of its own is behind it.

    Args:
        scene: the scene.
        names: dotted keys.
        caller: name of the function, for error messages.

    Raises:
        SceneError: if one is.
    """
    document = scene.document()
    for name in names:
        steps = key_steps(name)
        friction = _look_up(document, steps[: steps.index("isotropic")]) if "isotropic" in steps else None
        if isinstance(friction, dict) and "forward" in friction:
            raise SceneError(f"{caller}: {name}; the scene gives {' and '.join(friction)} there, name these")


def with_loads(scene: Scene, keys: Sequence[str]) -> Scene:
    """Give a scene without loads the ones that keys of its slope or its loads are about, all zero.

    Args:
        scene: the scene.
        keys: dotted keys.

    Returns:
        The same scene, or an equal one whose commands hold loads.
    """
    document = scene.document()
    has_loads = "loads" in document or "loads" in (document.get("drive") or {})  # a slope that is not 0 brings its own
    if has_loads or not any(key_steps(key)[0] in ("loads", "ground") for key in keys if isinstance(key, str)):
        return scene
    return Scene.model_validate(document | {"loads": 0.0 if scene.dimension == 1 else [0.0, 0.0]})


def _look_up(node: Any, steps: Sequence[str]) -> Any:
    """Find what a key names in a document; None if it is not there."""
    for step in steps:
        if isinstance(node, list):
            named = [part for part in node if isinstance(part, dict) and part.get("name") == step]
            inside = step.isdecimal() and int(step) < len(node)
            node = named[0] if named else node[int(step)] if inside else None
        else:
            node = node.get(step) if isinstance(node, dict) else None
    return node


def _names_below(node: list[Any], name: str) -> Iterator[str]:
    for i, part in enumerate(node):
        if isinstance(part, list):
            yield from _names_below(part, f"{name}[{i}]")
        else:
            yield f"{name}[{i}]"
