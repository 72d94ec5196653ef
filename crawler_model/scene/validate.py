"""Validate plain data as the parts of a scene, with one-line error messages."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from typing import Any, get_args

from pydantic import ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from ..errors import SceneError
from .parts import SceneParts

_LONGEST, _LONGEST_VALUE = 500, 200  # length of an error message, and of a value in it, in characters
_MOST_LISTED = 20  # keys listed in an error message
_NEAR = 0.6  # minimum similarity of a proposed key
_INNER = re.compile(r"function-|literal\[|(\w+Part|float|int|str)$")
"""Entries that pydantic adds to a path for unions of types."""
_PLAIN_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_WITH_UNIT = re.compile(r"\s*[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?\s*[a-zA-Z°µ/%^0-9]+$")
"""A number and a unit."""
_EXPECTED, _PLAIN = "Input should be ", {"a valid tuple": "a list", "a valid string": "text"}
"""How messages of pydantic begin that tell what a value must be, and plain words for some of that."""


def validate_parts(document: Any) -> SceneParts:
    """Validate plain data as the parts of a scene.

    Args:
        document: the content of a scene file, or `Scene.document()`.

    Returns:
        The parts of the scene.

    Raises:
        SceneError: with one line that names the field, the value and the valid values.
    """
    if not isinstance(document, dict):
        raise SceneError(f"a scene is a mapping with the keys {', '.join(SceneParts.model_fields)}")
    try:
        return SceneParts.model_validate(document)
    except ValidationError as error:
        raise SceneError(describe(error)) from None


def describe(error: ValidationError) -> str:
    """Describe the mistakes in a scene in one line.

    Args:
        error: error raised by pydantic.

    Returns:
        The first mistake, with unknown keys before all others, and the number of further mistakes.
    """
    mistakes = error.errors(include_url=False)
    mistakes.sort(key=lambda m: (_of_another_type(m), m["type"] != "extra_forbidden"))
    places = {tuple(_path_of(mistake)[:2]) for mistake in mistakes}  # a union reports one mistake per type
    more = f" (and {len(places) - 1} more mistake{'s' * (len(places) > 2)})" if len(places) > 1 else ""
    text = _describe_one(mistakes[0])
    return (text if len(text) <= _LONGEST else f"{text[:_LONGEST]} ...") + more


def _of_another_type(mistake: ErrorDetails) -> bool:
    """Return whether a mistake concerns a type of a union that was not intended."""
    given = mistake["input"]
    if isinstance(given, dict):
        return mistake["type"] in ("value_error", "literal_error") and "is not a number" in mistake["msg"]
    return mistake["type"] in ("model_type", "dict_type")


def _path_of(mistake: ErrorDetails) -> list[str]:
    return [str(p) for p in mistake["loc"] if not _INNER.match(str(p))]


def _shorten(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]} ..."


def _describe_one(mistake: ErrorDetails) -> str:
    path = _path_of(mistake)
    where = ".".join(path)
    if mistake["type"] == "extra_forbidden":
        return f"{where}: unknown key; {propose_key(path[-1], known_keys(path[:-1]))}"
    if mistake["type"] == "missing":
        return f"{where}: missing"
    if mistake["type"] in ("model_type", "dict_type"):
        return (
            f"{where or 'scene'}: {_shorten(mistake['input'])}; it must be a mapping with {', '.join(known_keys(path))}"
        )
    if mistake["msg"].startswith(_EXPECTED):
        wanted = mistake["msg"].removeprefix(_EXPECTED)
        mapping = f", or a mapping with {', '.join(known_keys(path))}" if path == ["start"] else ""
        return f"{where}: {_shorten(mistake['input'])}; it must be {_PLAIN.get(wanted, wanted)}{mapping}"
    text = mistake["msg"].removeprefix("Value error, ")
    if text.endswith("is not a number"):
        text += _explain_number(mistake["input"], path)
    return f"{where}: {text}" if where else text


def _explain_number(value: object, path: list[str]) -> str:
    """Explain a number in the spelling of other programs, as '0,1', or that was given with its unit, as '8 deg'."""
    if not isinstance(value, str):
        return ""
    plain = value.strip().replace("\u2212", "-").replace(",", ".")
    if _PLAIN_NUMBER.fullmatch(plain):
        return f"; write {plain}"
    if not _WITH_UNIT.match(value):
        return ""
    names = [p for p in path if not p.isdigit()]
    field = _fields(path[: path.index(names[-1])]).get(names[-1]) if names else None
    extra = field.json_schema_extra if field is not None else None
    unit = extra.get("unit") if isinstance(extra, dict) else None
    return f"; write only the number, {f'in {unit}' if unit else 'without a unit'}"


def known_keys(path: list[str]) -> Iterable[str]:
    """List the keys that a part of a scene may have.

    Args:
        path: keys from the scene down to the part; numbers are ignored.

    Returns:
        Its keys, as written in files.
    """
    return list(_fields(path))


def _fields(path: list[str]) -> dict[str, FieldInfo]:
    """Find the fields of the part of a scene that a path leads to, by their names in files; none of a value."""
    fields = _fields_in(SceneParts)
    for step in path:
        if not step.isdigit():
            fields = _fields_in(fields[step].annotation) if step in fields else {}
    return fields


def _fields_in(annotation: Any) -> dict[str, FieldInfo]:
    """Find the fields of all parts in an annotation: of a part, or of a union or a list of some."""
    own = getattr(annotation, "model_fields", {})
    inner = [_fields_in(part) for part in get_args(annotation)]
    return {field.alias or name: field for fields in (own, *inner) for name, field in fields.items()}


def propose_key(key: str, known: Iterable[str]) -> str:
    """Propose the key that was probably intended.

    Args:
        key: the unknown key.
        known: the valid keys.

    Returns:
        A phrase with the most similar key, or with the valid keys if none is similar.
    """
    keys = list(known)
    nearest = difflib.get_close_matches(key, keys, n=1, cutoff=_NEAR)
    if nearest:
        return f"the nearest known key is {nearest[0]!r}"
    return f"known keys are {', '.join(keys[:_MOST_LISTED])}{', ...' if len(keys) > _MOST_LISTED else ''}"
