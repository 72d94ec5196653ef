"""Types of the values in a scene file, and the base of its parts."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, WithJsonSchema

from ..errors import LARGEST

_NUMBER = {"type": "number"}
_NUMBERS = {"anyOf": [_NUMBER, {"type": "array", "items": _NUMBER}]}
_TABLE = {"anyOf": [_NUMBER, {"type": "array", "items": _NUMBERS}]}
_DEEP = {"anyOf": [_NUMBER, {"type": "array", "items": _TABLE}]}


def _number(value: Any) -> float:
    if isinstance(value, str):  # YAML 1.1 reads 1e-3 as text
        try:
            value = float(value)
        except ValueError:
            raise ValueError(f"{value!r} is not a number") from None
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ValueError(f"{value!r} is not a number")
    if isinstance(value, int) and abs(value) > LARGEST:
        raise ValueError(f"an integer of {value.bit_length()} bits is too large; at most {LARGEST:g}")
    if not math.isfinite(value):
        raise ValueError(f"{value!r} is not finite")
    if abs(value) > LARGEST:
        raise ValueError(f"{value!r} is too large; at most {LARGEST:g}")
    return float(value)


def _nested(value: Any, depth: int) -> Any:
    if depth > 0 and isinstance(value, (list, tuple)):
        return tuple(_nested(v, depth - 1) for v in value)
    return _number(value)


Number = Annotated[float, BeforeValidator(_number), WithJsonSchema(_NUMBER)]
Numbers = Annotated[Any, BeforeValidator(lambda v: _nested(v, 1)), WithJsonSchema(_NUMBERS)]
Table = Annotated[Any, BeforeValidator(lambda v: _nested(v, 2)), WithJsonSchema(_TABLE)]
Deep = Annotated[Any, BeforeValidator(lambda v: _nested(v, 3)), WithJsonSchema(_DEEP)]


class Part(BaseModel):
    """Base of the parts of a scene: unknown keys are refused, values are fixed."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


def key(meaning: str, unit: str = "", **bounds: float) -> Any:
    """Describe a key for the schema and docs/reference/scenes.md.

    Args:
        meaning: one sentence.
        unit: unit of its values.
        **bounds: bounds, named as in JSON schema.

    Returns:
        The field.
    """
    return Field(description=meaning, json_schema_extra={**({"unit": unit} if unit else {}), **bounds})
