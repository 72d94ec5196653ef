"""Scene files and the gallery: YAML to `Scene`, every mistake answered in one line."""

from __future__ import annotations

import difflib
import itertools
import json
import re
from importlib import resources
from pathlib import Path
from typing import Any, ClassVar

import yaml

from ..errors import SceneError
from .scene import Scene

LARGEST_FILE = 16 << 20
"""Bytes."""
_MOST_VALUES = 1_000_000
"""Numbers and other values in a scene; about a second is spent on them."""
_MOST_YAML = 50_000
"""Values in a file that is YAML and not JSON, which is read fifty times quicker."""
_DEEPEST = 100
"""Collections in one another."""


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Plain data only, numbers as in YAML 1.2 (YAML 1.1 takes 1:30 for 90), and no key twice."""

    yaml_implicit_resolvers: ClassVar[dict[str, list[Any]]] = {
        first: [(tag, pattern) for tag, pattern in known if not tag.endswith((":int", ":float", ":timestamp"))]
        for first, known in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }


for _tag, _pattern in (
    ("int", r"[-+]?[0-9]+"),
    ("float", r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"),
):
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(rf"^({_pattern})$"), list("-+.0123456789"))


def _decimal(loader: _Loader, node: yaml.ScalarNode) -> int:
    return int(loader.construct_scalar(node))


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
_Loader.add_constructor("tag:yaml.org,2002:int", _decimal)  # 010 is ten


def _pairs_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make a mapping of JSON, in which no key is given twice."""
    mapping = dict(pairs)
    if len(mapping) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in mapping if keys.count(key) > 1)
        raise SceneError(f"key {twice!r} is given twice")
    return mapping


_OPENS = re.compile(r"[\[{,\n]|[-?:](?=\s)")
"""What a further value of YAML or JSON begins with, at least."""


def _check_size(text: str, most: int) -> None:
    """Refuse a text before it is read that may hold more values than can be read in about a second."""
    count = sum(1 for _ in itertools.islice(_OPENS.finditer(text), most + 1))
    if count > most:
        raise SceneError(
            f"more than {most} values or lines; " + ("write it as JSON" if most < _MOST_VALUES else "a scene has fewer")
        )


def _check_depth(text: str) -> None:
    """Refuse collections in one another that would exhaust the stack; nothing is built of them yet."""
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST:
            raise SceneError(f"more than {_DEEPEST} lists or mappings in one another")


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
    _check_size(text, _MOST_VALUES)
    try:
        return json.loads(text, object_pairs_hook=_pairs_once)
    except json.JSONDecodeError:
        pass
    except RecursionError:
        raise SceneError(f"more than {_DEEPEST} lists or mappings in one another") from None
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
    except SceneError as error:
        raise SceneError(f"{source}: {error}") from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f" in line {mark.line + 1}" if mark is not None else ""
        raise SceneError(f"{source}: not plain YAML{where}: {error.problem}") from None
    except (yaml.YAMLError, RecursionError, ValueError) as error:  # a date or an integer may be none
        raise SceneError(f"{source}: not plain YAML: {' '.join(str(error).split())[:200]}") from None
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


def take_scene(scene: Scene | str | Path, call: str) -> Scene:
    """Take a scene, or load the one that is named.

    Args:
        scene: a scene, a path, or a name that `gallery` lists.
        call: what to call the receiver in errors.

    Returns:
        The scene.

    Raises:
        SceneError: when it is something else, or cannot be loaded.
    """
    if isinstance(scene, Scene):
        return scene
    if isinstance(scene, (str, Path)):
        return load_scene(scene)
    given = " ".join(repr(scene).split())
    raise SceneError(
        f"{call}: {given if len(given) <= 60 else given[:60] + ' ...'}; it takes a Scene, a path or a name of the "
        "gallery; Scene.model_validate makes a Scene of a mapping"
    )
