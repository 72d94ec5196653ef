"""Scene files and the gallery: YAML to `Scene`, every mistake answered in one line."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from .errors import SceneError
from .scene import (
    BodyPart,
    DrivePart,
    FrictionPart,
    FrictionRowsPart,
    LinksPart,
    Scene,
    SegmentPart,
    StartPart,
    WavePart,
)

LARGEST_FILE = 16 << 20
"""Bytes."""
_MOST_VALUES = 5_000_000
_LONGEST = 500  # of an error, in characters

_INNER = re.compile(r"function-|literal\[|(\w+Part|float|int|str)$")
"""What the validator adds to a path where a value may be of several kinds."""


class _Loader(yaml.SafeLoader):
    """Plain data only, and no key twice."""


def _mapping_once(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    seen: set[Any] = set()
    for key_node, _ in node.value:
        key = loader.construct_object(key_node)
        if not isinstance(key, str):
            raise yaml.constructor.ConstructorError(None, None, f"key {key!r} is not text", key_node.start_mark)
        if key in seen:
            raise yaml.constructor.ConstructorError(None, None, f"key {key!r} is given twice", key_node.start_mark)
        seen.add(key)
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping_once)


def _check_aliases(root: yaml.Node, most: int = _MOST_VALUES) -> None:
    """Refuse aliases that stand for more values than a scene can hold: a few lines can stand for billions."""
    sizes: dict[int, int] = {}
    waiting = [root]
    while waiting:
        node = waiting[-1]
        inner = node.value if isinstance(node, yaml.CollectionNode) else []
        children = [n for pair in inner for n in pair] if isinstance(node, yaml.MappingNode) else inner
        if id(node) not in sizes:
            sizes[id(node)] = most  # until it is known: what contains itself is endless
            waiting += [child for child in children if id(child) not in sizes]
            continue
        waiting.pop()
        if sizes[id(node)] != most:
            continue
        sizes[id(node)] = 1 + sum(sizes[id(child)] for child in children)
        if sizes[id(node)] > most:
            text = f"with its aliases written out it holds more than {most} values"
            raise yaml.constructor.ConstructorError(None, None, text, node.start_mark)


def _load_plain(text: str) -> Any:
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _check_aliases(node)
        return loader.construct_document(node)
    finally:
        loader.dispose()


def parse_scene(text: str, source: str = "scene") -> Scene:
    """Read a scene from YAML (or JSON, which is YAML).

    Args:
        text: the file's content.
        source: what to call it in errors.

    Returns:
        The scene.

    Raises:
        SceneError: one line that names the field, the value and what would be right.
    """
    try:
        data = _load_plain(text)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f" in line {mark.line + 1}" if mark is not None else ""
        raise SceneError(f"{source}: not plain YAML{where}: {error.problem}") from None
    except (yaml.YAMLError, RecursionError, ValueError) as error:  # a date or an integer may be none
        raise SceneError(f"{source}: not plain YAML: {' '.join(str(error).split())[:200]}") from None
    if not isinstance(data, dict):
        raise SceneError(f"{source}: a scene is a mapping with the keys {', '.join(Scene.model_fields)}")
    return build_scene(data, source)


def build_scene(document: Any, source: str) -> Scene:
    """Make a scene of plain data, as `Scene.document` lays it out.

    Args:
        document: what a scene file holds.
        source: what to call it in errors; "" for nothing.

    Returns:
        The scene.

    Raises:
        SceneError: one line that names the field, the value and what would be right.
    """
    try:
        return Scene.model_validate(document)
    except ValidationError as error:
        raise SceneError(f"{source}: {describe(error)}" if source else describe(error)) from None


def describe(error: ValidationError) -> str:
    """Say in one line what is wrong with a scene.

    Args:
        error: what `Scene.model_validate` raised.

    Returns:
        The first mistake, unknown keys before all others, and how many more there are.
    """
    mistakes = error.errors(include_url=False)
    mistakes.sort(key=lambda m: (_of_another_kind(m), m["type"] != "extra_forbidden"))
    places = {mistake["loc"][:2] for mistake in mistakes}  # a value of several kinds is wrong in several ways
    more = f" (and {len(places) - 1} more mistake{'s' * (len(places) > 2)})" if len(places) > 1 else ""
    text = _describe_one(mistakes[0])
    return (text if len(text) <= _LONGEST else f"{text[:_LONGEST]} ...") + more


def _of_another_kind(mistake: ErrorDetails) -> bool:
    """Tell mistakes of a kind that was not meant, where a value may be of several kinds."""
    given = mistake["input"]
    if isinstance(given, dict):
        return mistake["type"] in ("value_error", "literal_error") and "is not a number" in mistake["msg"]
    return mistake["type"] in ("model_type", "dict_type")


def _describe_one(mistake: ErrorDetails) -> str:
    path = [str(p) for p in mistake["loc"] if not _INNER.match(str(p))]
    where = ".".join(path)
    if mistake["type"] == "extra_forbidden":
        known = known_keys(path[:-1])
        nearest = difflib.get_close_matches(path[-1], known, n=1, cutoff=0.0)
        return f"{where}: unknown key; the nearest known key is {nearest[0]!r}" if nearest else f"{where}: unknown key"
    if mistake["type"] == "missing":
        return f"{where}: missing"
    if mistake["type"] in ("model_type", "dict_type"):
        return f"{where}: {mistake['input']!r}; it must be a mapping with {', '.join(known_keys(path))}"
    text = mistake["msg"].removeprefix("Value error, ")
    if text.startswith(
        ("body.", "body:", "friction.", "friction:", "start.", "drive.", "drive:", "dimension", "tolerance:")
    ):
        return text
    return f"{where}: {text}" if where else text


def known_keys(path: list[str]) -> Iterable[str]:
    """List the keys that a part of a scene may have.

    Args:
        path: keys from the scene down to the part; numbers among them count for nothing.

    Returns:
        Its keys, as files write them.
    """
    model: type[BaseModel] = Scene
    parts: dict[str, type[BaseModel]] = {
        "body": BodyPart,
        "links": LinksPart,
        "segments": SegmentPart,
        "friction": FrictionRowsPart if "drive" in path else FrictionPart,
        "start": StartPart,
        "drive": DrivePart,
        "wave": WavePart,
        "friction_wave": WavePart,
    }
    path = [p for p in path if not p.isdigit()]
    if path:
        model = parts.get(path[-1], Scene)
    return [field.alias or name for name, field in model.model_fields.items()]


def gallery() -> dict[str, str]:
    """List the scenes that come with the package.

    Returns:
        Each scene's name and the first line of its comment.
    """
    folder = resources.files("msgs_config") / "scenes"
    scenes = {}
    for file in sorted(folder.iterdir(), key=lambda f: f.name):
        if file.name.endswith(".yaml"):
            first = file.read_text(encoding="utf-8").splitlines()[0]
            scenes[file.name.removesuffix(".yaml")] = first.lstrip("# ").strip()
    return scenes


def _read(path: Path) -> str:
    """Read a regular file of a scene's size; files of /proc and /sys, of which the size is not known, are none."""
    size = path.stat().st_size
    if size == 0:
        raise ValueError("it is empty")
    if size > LARGEST_FILE:
        raise ValueError(f"it has {size} bytes; a scene has at most {LARGEST_FILE}")
    with path.open("rb") as stream:
        return stream.read(LARGEST_FILE).decode("utf-8")


def load_scene(path_or_name: str | Path) -> Scene:
    """Load a scene file or a scene of the gallery.

    Args:
        path_or_name: a path (anything with a suffix or a separator), or a name that `gallery` lists.

    Returns:
        The scene.

    Raises:
        SceneError: when there is no such scene, or something in it is wrong.
    """
    text = str(path_or_name)
    path = Path(text)
    if path.is_file() and (path.suffix or len(path.parts) > 1):
        try:
            content = _read(path)
        except (OSError, ValueError) as error:
            raise SceneError(f"{text}: cannot be read: {error}") from None
        return parse_scene(content, text)
    known = gallery()
    if text in known:
        file = resources.files("msgs_config") / "scenes" / f"{text}.yaml"
        return parse_scene(file.read_text(encoding="utf-8"), text)
    if path.suffix or len(path.parts) > 1:
        there = "not a file: a scene is read from a regular file" if path.exists() else "no such file"
        raise SceneError(f"{text}: {there}")
    nearest = difflib.get_close_matches(text, known, n=1, cutoff=0.5)
    hint = f"the nearest is {nearest[0]!r}" if nearest else f"there are {', '.join(known)}"
    raise SceneError(f"{text}: no such file, nor a scene of the gallery; {hint}")
