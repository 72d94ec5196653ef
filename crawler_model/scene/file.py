"""Scene files and the gallery: from YAML to `Scene`, with a one-line error for every mistake."""

from __future__ import annotations

import difflib
import functools
import itertools
import json
import os
import re
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any, ClassVar

import yaml

from ..errors import SceneError
from .scene import Scene
from .text import decode_text

LARGEST_FILE = 16 << 20
"""Maximum size of a scene file, in bytes."""
_MOST_VALUES = 1_000_000
"""Maximum number of values in a scene; they take about a second to read."""
_MOST_YAML = 50_000
"""Maximum number of values in YAML; JSON is read fifty times faster."""
_MOST_DIGITS = 1000
"""Of a number; a float has at most some 300 before its decimal point."""
_DEEPEST = 100
"""Maximum depth of nested lists and mappings."""


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Loader for plain data: numbers as in YAML 1.2 (YAML 1.1 reads 1:30 as 90), no duplicate keys."""

    yaml_implicit_resolvers: ClassVar[dict[str, list[Any]]] = {
        first: [(tag, pattern) for tag, pattern in known if not tag.endswith((":int", ":float", ":timestamp"))]
        for first, known in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }


for _tag, _pattern in (
    ("int", r"[-+]?[0-9]+"),
    ("float", r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"),
):
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(rf"^({_pattern})$"), list("-+.0123456789"))


def _mapping_once(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    seen: set[Any] = set()
    for key_node, _ in node.value:
        if key_node.tag == "tag:yaml.org,2002:merge":
            raise yaml.constructor.ConstructorError(
                None, None, "key '<<' merges another mapping; write its keys out", key_node.start_mark
            )
        key = loader.construct_object(key_node)
        if not isinstance(key, str):
            text = f"key {key!r} is not text"
            if isinstance(key, (int, float)) and not isinstance(key, bool):
                text += "; numbers have a decimal point: a comma begins another key"
            raise yaml.constructor.ConstructorError(None, None, text, key_node.start_mark)
        if key in seen:
            raise yaml.constructor.ConstructorError(None, None, f"key {key!r} is given twice", key_node.start_mark)
        seen.add(key)
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping_once)


def _number(kind: type[int] | type[float], loader: _Loader, node: yaml.ScalarNode) -> int | float:
    """Read a number as Python does, 010 as ten, but infinity and NaN as YAML writes them."""
    text = loader.construct_scalar(node)
    if len(text) > _MOST_DIGITS:
        raise yaml.constructor.ConstructorError(None, None, f"a number of {len(text)} digits", node.start_mark)
    try:
        return kind(text.replace(".i", "i").replace(".I", "I").replace(".n", "n").replace(".N", "N"))
    except ValueError:
        raise yaml.constructor.ConstructorError(None, None, f"{text!r} is not a number", node.start_mark) from None


for _kind in (int, float):
    _Loader.add_constructor(f"tag:yaml.org,2002:{_kind.__name__}", functools.partial(_number, _kind))


def _pairs_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Build a mapping from JSON pairs; duplicate keys are an error."""
    mapping = dict(pairs)
    if len(mapping) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in mapping if keys.count(key) > 1)
        raise SceneError(f"key {twice!r} is given twice")
    return mapping


_OPENS = re.compile(r"[\[{,\n]|[-?:](?=\s)")
"""Matches at least once per further value of YAML or JSON."""


def _check_size(text: str, most: int) -> None:
    """Raise an error before parsing if a text may hold more values than can be read in about a second."""
    count = sum(1 for _ in itertools.islice(_OPENS.finditer(text), most + 1))
    if count > most:
        raise SceneError(
            f"more than {most} values or lines; " + ("write it as JSON" if most < _MOST_VALUES else "a scene has fewer")
        )


def _check_depth(text: str) -> None:
    """Raise an error for nesting that would exhaust the stack; only parser events are read here."""
    depth = 0
    try:
        for event in yaml.parse(text, Loader=_Loader):
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > _DEEPEST:
                break
    except yaml.YAMLError as error:
        if "nesting depth" not in str(error):  # versions of PyYAML since 6.0.4 have a limit of their own
            raise
        depth = _DEEPEST + 1
    if depth > _DEEPEST:
        raise SceneError(f"more than {_DEEPEST} nested lists or mappings")


def _check_aliases(root: yaml.Node, most: int = _MOST_VALUES) -> None:
    """Raise an error if aliases expand to more values than a scene can hold; a few lines can expand to billions."""
    sizes: dict[int, int] = {}
    waiting = [root]
    while waiting:
        node = waiting[-1]
        inner = node.value if isinstance(node, yaml.CollectionNode) else []
        children = [n for pair in inner for n in pair] if isinstance(node, yaml.MappingNode) else inner
        if id(node) not in sizes:
            sizes[id(node)] = most  # until it is known; a node that contains itself is infinite
            waiting += [child for child in children if id(child) not in sizes]
            continue
        waiting.pop()
        if sizes[id(node)] != most:
            continue
        sizes[id(node)] = 1 + sum(sizes[id(child)] for child in children)
        if sizes[id(node)] > most:
            text = f"with its aliases expanded it holds more than {most} values"
            raise yaml.constructor.ConstructorError(None, None, text, node.start_mark)


def _load_plain(text: str) -> Any:
    _check_size(text, _MOST_VALUES)
    try:
        return json.loads(text, object_pairs_hook=_pairs_once)
    except json.JSONDecodeError:
        pass
    except RecursionError:
        raise SceneError(f"more than {_DEEPEST} nested lists or mappings") from None
    _check_size(text, _MOST_YAML)
    _check_depth(text)
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _check_aliases(node)
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _parse(text: str, source: str) -> Any:
    """Read plain data; errors name the source."""
    try:
        return _load_plain(text)
    except SceneError as error:
        raise SceneError(f"{source}: {error}") from None
    except yaml.MarkedYAMLError as error:
        mark, problem = error.problem_mark, error.problem
        where = f" in line {mark.line + 1}" if mark is not None else ""
        if mark is not None and "\t" in "".join(text.split("\n")[mark.line : mark.line + 1])[: mark.column + 1]:
            problem = f"{problem}; it is a tab: indent with spaces"
        raise SceneError(f"{source}: not plain YAML{where}: {problem}") from None
    except (yaml.YAMLError, RecursionError, ValueError) as error:  # e.g. an impossible date
        raise SceneError(f"{source}: not plain YAML: {' '.join(str(error).split())[:200]}") from None


def parse_scene(text: str, source: str = "scene") -> Scene:
    """Read a scene from YAML or JSON text.

    Args:
        text: content of a scene file.
        source: name of the source in error messages.

    Returns:
        The scene.

    Raises:
        SceneError: with one line that names the field, the value and the valid values.
    """
    if not isinstance(text, str):
        raise SceneError(f"{source}: {type(text).__name__}; the content of a scene file must be text")
    data = _parse(text, source)
    try:
        return Scene.model_validate(data)
    except SceneError as error:
        raise SceneError(f"{source}: {error}") from None


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


def _is_path(text: str) -> bool:
    """Return whether a text means a path, not the name of a scene."""
    return bool(Path(text).suffix) or os.sep in text


def _read(path: Path, name: str) -> str:
    """Read a regular file of limited size; files of unknown size, as in /proc and /sys, are rejected as empty."""
    try:
        size = path.stat().st_size
        if size == 0:
            raise ValueError("it is empty")
        if size > LARGEST_FILE:
            raise ValueError(f"it has {size} bytes; a scene has at most {LARGEST_FILE}")
        with path.open("rb") as stream:
            return decode_text(stream.read(LARGEST_FILE))
    except (OSError, ValueError) as error:
        raise SceneError(f"{name}: cannot be read: {error}") from None


def load_drive(path_or_name: str | Path) -> Mapping[str, Any]:
    """Load the drive of a scene, whose other parts are not checked and may be missing.

    Args:
        path_or_name: a path to a file with the key `drive`, or a name listed by `gallery`.

    Returns:
        The part `drive`.

    Raises:
        SceneError: if there is no such file or scene, or it has no drive.
    """
    text = str(path_or_name)
    path = Path(text)
    data = _parse(_read(path, text), text) if _is_path(text) and path.is_file() else load_scene(text).document()
    drive = data.get("drive") if isinstance(data, Mapping) else None
    if not isinstance(drive, Mapping):
        raise SceneError(f"{text}: no drive; it must have a part `drive:`, as a scene or what `crawler excite` writes")
    return drive


def load_scene(path_or_name: str | Path) -> Scene:
    """Load a scene from a file or from the gallery.

    Args:
        path_or_name: a path (anything with a suffix or a separator; a `Path` keeps no `./`, a text does), or a name
            listed by `gallery`.

    Returns:
        The scene.

    Raises:
        SceneError: if there is no such scene, or if it is invalid.
    """
    text = str(path_or_name)
    path = Path(text)
    if _is_path(text) and path.is_file():
        return parse_scene(_read(path, text), text)
    known = gallery()
    if text in known:
        file = resources.files("msgs_config") / "scenes" / f"{text}.yaml"
        return parse_scene(file.read_text(encoding="utf-8"), text)
    if _is_path(text):
        there = "not a file: a scene is read from a regular file" if path.exists() else "no such file"
        raise SceneError(f"{text}: {there}")
    files = [name for name in (f"{text}.yaml", f"{text}.yml") if Path(name).is_file()]
    if files:
        raise SceneError(f"{text}: no scene of the gallery; a file is named with its ending, {files[0]}")
    nearest = difflib.get_close_matches(text, known, n=1, cutoff=0.5)
    hint = f"the nearest is {nearest[0]!r}" if nearest else f"there are {', '.join(known)}"
    raise SceneError(f"{text}: no such file, nor a scene of the gallery; {hint}")


def coerce_scene(scene: Scene | str | Path, call: str) -> Scene:
    """Return a scene unchanged, or load it by path or name.

    Args:
        scene: a scene, a path, or a name listed by `gallery`.
        call: name of the caller, for error messages.

    Returns:
        The scene.

    Raises:
        SceneError: if it is something else, or cannot be loaded.
    """
    if isinstance(scene, Scene):
        return scene
    if isinstance(scene, (str, Path)):
        return load_scene(scene)
    given = " ".join(repr(scene).split())
    raise SceneError(
        f"{call}: {given if len(given) <= 60 else given[:60] + ' ...'}; it must be a Scene, a path or a gallery "
        "name; Scene.model_validate builds a Scene from a mapping"
    )
