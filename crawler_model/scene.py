"""Scene files: what a crawler is made of, how it starts and what drives it. Every mistake is named."""

from __future__ import annotations

import difflib
import functools
import math
from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError, WithJsonSchema, model_validator
from pydantic_core import ErrorDetails

from . import drive as drives
from .body import Body, build_body, spread
from .drive import Drive
from .errors import LARGEST, SceneError
from .friction import Friction, build_friction
from .stasis import rounding_of_forces, spring_force, stasis_margins

_NUMBER = {"type": "number"}
_NUMBERS = {"anyOf": [_NUMBER, {"type": "array", "items": _NUMBER}]}
_TABLE = {"anyOf": [_NUMBER, {"type": "array", "items": _NUMBERS}]}


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


def _numbers(value: Any) -> float | tuple[float, ...]:
    if isinstance(value, (list, tuple)):
        return tuple(_number(v) for v in value)
    return _number(value)


def _table(value: Any) -> float | tuple[float | tuple[float, ...], ...]:
    if not isinstance(value, (list, tuple)):
        return _number(value)
    return tuple(_numbers(v) for v in value)


Number = Annotated[float, BeforeValidator(_number), WithJsonSchema(_NUMBER)]
Numbers = Annotated[Any, BeforeValidator(_numbers), WithJsonSchema(_NUMBERS)]
Table = Annotated[Any, BeforeValidator(_table), WithJsonSchema(_TABLE)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class LinksPart(_Part):
    """The springs."""

    stiffness: Numbers
    between: tuple[tuple[int, int], ...] | None = None


class BodyPart(_Part):
    """Contacts and links."""

    contacts: tuple[Number, ...]
    links: LinksPart


def _explain_friction(value: Any) -> Any:
    if isinstance(value, (int, float, list, tuple)):
        raise ValueError(f"write {{isotropic: {value}}}, or give `forward` and `backward`")
    return value


class FrictionPart(_Part):
    """Friction of the contacts: forward and backward, or isotropic."""

    forward: Numbers | None = None
    backward: Numbers | None = None
    isotropic: Numbers | None = None

    @model_validator(mode="after")
    def _one_way(self) -> FrictionPart:
        _check_one_way(self)
        return self

    @property
    def sides(self) -> tuple[Any, Any]:
        """What forward and backward friction are."""
        return _sides(self)


class FrictionRowsPart(_Part):
    """Commanded friction, a row per time: forward and backward, or isotropic."""

    forward: Table | None = None
    backward: Table | None = None
    isotropic: Table | None = None

    @model_validator(mode="after")
    def _one_way(self) -> FrictionRowsPart:
        _check_one_way(self)
        return self

    @property
    def sides(self) -> tuple[Any, Any]:
        """What forward and backward friction are."""
        return _sides(self)


def _check_one_way(part: FrictionPart | FrictionRowsPart) -> None:
    both = part.forward is not None and part.backward is not None
    neither = part.forward is None and part.backward is None
    if not ((both and part.isotropic is None) or (neither and part.isotropic is not None)):
        raise ValueError("give both `forward` and `backward`, or `isotropic` alone")


def _sides(part: FrictionPart | FrictionRowsPart) -> tuple[Any, Any]:
    return (part.forward, part.backward) if part.isotropic is None else (part.isotropic, part.isotropic)


class StartPart(_Part):
    """Where the contacts stand at the start."""

    displacement: Numbers


class WavePart(_Part):
    """A travelling sine, sampled."""

    amplitude: Number
    wavelength: Number
    period: Number
    mean: Number = 0.0
    samples: int = 64

    @model_validator(mode="after")
    def _sane(self) -> WavePart:
        if self.wavelength == 0.0:
            raise ValueError("wavelength: 0 m; it must not be 0")
        if not self.period > 0.0:
            raise ValueError(f"period: {self.period:g} s; it must be > 0")
        if not 3 <= self.samples <= 1_000_000:
            raise ValueError(f"samples: {self.samples}; it must be between 3 and 1000000")
        return self


class DrivePart(_Part):
    """Open-loop commands: times, or wave and friction_wave, or strategy."""

    times: tuple[Number, ...] | None = None
    period: Number | None = None
    actuation: Table | None = None
    friction: FrictionRowsPart | Number | None = None
    wave: WavePart | None = None
    friction_wave: WavePart | None = None
    strategy: Literal["A", "B", "C"] | None = None
    length: Number | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> DrivePart:
        waves = self.wave is not None or self.friction_wave is not None
        kinds = [self.times is not None, waves, self.strategy is not None]
        if sum(kinds) != 1:
            raise ValueError("give exactly one of `times`, `wave` and `friction_wave`, or `strategy`")
        allowed = {"times", "period", "actuation", "friction"}
        if waves:
            allowed = {"wave", "friction_wave"}
        elif self.strategy is not None:
            allowed = {"strategy", "length", "friction", "period"}
        for key in sorted(self.model_fields_set - allowed):
            if getattr(self, key) is not None:
                raise ValueError(f"`{key}` does not go with this kind of drive; it takes {', '.join(sorted(allowed))}")
        if self.times is not None and self.actuation is None:
            raise ValueError("`actuation` is missing: one row per time")
        if self.times is not None and isinstance(self.friction, float):
            raise ValueError("friction: with `times`, give `isotropic`, or `forward` and `backward`, a row per time")
        if self.strategy is not None:
            if self.length is None or not isinstance(self.friction, float):
                raise ValueError("a strategy needs `length` (m) and `friction` (N), a number each")
            if self.friction < 0.0:
                raise ValueError(f"friction: {self.friction:g} N; it must be >= 0")
        return self


class Scene(_Part):
    """A crawler, its ground, its start and its drive. Frozen; made by `load_scene` or `Scene.model_validate`.

    Source of the format: docs/scenes.md. SI units throughout.
    """

    name: str
    body: BodyPart
    friction: Annotated[FrictionPart, BeforeValidator(_explain_friction)]
    start: StartPart | None = None
    drive: DrivePart | None = None

    @model_validator(mode="before")
    @classmethod
    def _known_to_come(cls, data: Any) -> Any:
        if isinstance(data, dict):
            body = data.get("body")
            if isinstance(body, dict) and "segments" in body:
                raise SceneError("body.segments: continuous bodies are not available in this version; use contacts")
            if "dimension" in data:
                raise SceneError("dimension: planar bodies are not available in this version; leave it out")
        return data

    @model_validator(mode="after")
    def _fits_together(self) -> Scene:
        check_start(self)
        return self

    def document(self) -> dict[str, Any]:
        """Lay the scene out as plain data that `Scene.model_validate` reads back."""
        return self.model_dump(mode="json", exclude_none=True)

    @functools.cached_property
    def chain(self) -> Body:
        """The body as arrays."""
        links = self.body.links
        return build_body(self.body.contacts, links.stiffness, None if links.between is None else list(links.between))

    @functools.cached_property
    def ground(self) -> Friction:
        """The scene's own friction, in force when no drive commands another."""
        forward, backward = self.friction.sides
        return build_friction(forward, backward, self.chain.contacts)

    @functools.cached_property
    def commands(self) -> Drive:
        """The drive, or for a scene without one L = 0 and the scene's friction for ever."""
        return build_drive(self)

    @functools.cached_property
    def start_displacement(self) -> np.ndarray:
        """X at the start, shape (N,) [m]."""
        given = 0.0 if self.start is None else self.start.displacement
        return spread(given, self.chain.contacts, "start.displacement", "contact")


def build_drive(scene: Scene) -> Drive:
    """Make waypoints of a scene's drive.

    Args:
        scene: the scene.

    Returns:
        The drive, with the scene's friction where it commands none.

    Raises:
        SceneError: naming the row or value that does not fit.
    """
    body, ground, part = scene.chain, scene.ground, scene.drive
    if part is None:
        return drives.hold(body, ground)
    if part.strategy is not None:
        if body.contacts != 2:
            raise SceneError(f"drive.strategy: strategies drive 2 contacts, this body has {body.contacts}")
        assert isinstance(part.friction, float)
        assert part.length is not None
        period = 1.0 if part.period is None else part.period
        times, actuation, mu = drives.strategy_waypoints(part.strategy, part.length, part.friction, period)
        return drives.build_waypoints(times, period, actuation, mu, mu)
    if part.times is not None:
        times = np.array(part.times)
        actuation = _rows(part.actuation, times.size, body.links, "drive.actuation", "link")
        forward, backward = (np.tile(mu, (times.size, 1)) for mu in (ground.forward, ground.backward))
        if isinstance(part.friction, FrictionRowsPart):
            isotropic = part.friction.isotropic is not None
            sides = ("isotropic", "isotropic") if isotropic else ("forward", "backward")
            forward, backward = (
                _rows(rows, times.size, body.contacts, f"drive.friction.{side}", "contact")
                for side, rows in zip(sides, part.friction.sides, strict=True)
            )
        return drives.build_waypoints(times, part.period, actuation, forward, backward)
    return _build_waves(scene, part)


def _build_waves(scene: Scene, part: DrivePart) -> Drive:
    body, ground = scene.chain, scene.ground
    waves = [w for w in (part.wave, part.friction_wave) if w is not None]
    period = waves[0].period
    if any(w.period != period for w in waves):
        raise SceneError("drive.friction_wave.period: it must be that of drive.wave")
    times = drives.merge_times(*(np.arange(w.samples + 1) * (period / w.samples) for w in waves))
    times[-1] = period
    phase = times / period
    actuation = np.zeros((times.size, body.links))
    if part.wave is not None:
        middle = 0.5 * (body.position[:-1] + body.position[1:])
        w = part.wave
        actuation = drives.wave(w.mean, w.amplitude, w.wavelength, phase, middle)
    forward, backward = (np.tile(mu, (times.size, 1)) for mu in (ground.forward, ground.backward))
    if part.friction_wave is not None:
        w = part.friction_wave
        if w.mean < abs(w.amplitude):
            raise SceneError(
                f"drive.friction_wave: mean {w.mean:g} N is less than the amplitude {abs(w.amplitude):g} N; "
                "friction must be >= 0 all the time"
            )
        mu = np.maximum(drives.wave(w.mean, w.amplitude, w.wavelength, phase, body.position), 0.0)
        forward, backward = mu, mu
    return drives.build_waypoints(times, period, actuation, forward, backward)


def _rows(table: Any, rows: int, columns: int, field: str, item: str) -> np.ndarray:
    if isinstance(table, float):
        return np.full((rows, columns), table)
    if len(table) != rows:
        raise SceneError(f"{field}: {len(table)} row(s) for {rows} time(s); give one row per time")
    return np.array([spread(row, columns, f"{field}: row {i}", item) for i, row in enumerate(table)])


def check_start(scene: Scene) -> None:
    """Check that the springs' forces at the start are within the friction at the start.

    Args:
        scene: the scene; its parts are built and so checked on the way.

    Raises:
        SceneError: naming the contact and by how much its bound is exceeded.
    """
    body, drive, x = scene.chain, scene.commands, scene.start_displacement
    tension = body.stiffness * (np.diff(x) - drive.actuation[0])
    forward, backward = drive.forward[0], drive.backward[0]
    margins = stasis_margins(tension, forward, backward)
    excess = margins + 1e3 * rounding_of_forces(tension, forward + backward)
    worst = int(np.argmin(excess))
    if excess[worst] >= 0.0:
        return
    g = spring_force(tension)[worst]
    bound, side = (forward[worst], "forward") if g > 0.0 else (backward[worst], "backward")
    relaxed = x[0] + np.concatenate(([0.0], np.cumsum(drive.actuation[0])))
    text = ", ".join(f"{v:.6g}" for v in relaxed[:12]) + (", ..." if relaxed.size > 12 else "")
    raise SceneError(
        f"start.displacement: contact {worst} is pulled by {abs(g):g} N, {-margins[worst]:g} N more than its "
        f"{side} friction {bound:g} N; a start without tension is [{text}]"
    )


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
        data = yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f" in line {mark.line + 1}" if mark is not None else ""
        raise SceneError(f"{source}: not plain YAML{where}: {error.problem}") from None
    except (yaml.YAMLError, RecursionError) as error:
        raise SceneError(f"{source}: not plain YAML: {' '.join(str(error).split())[:200]}") from None
    if not isinstance(data, dict):
        raise SceneError(f"{source}: a scene is a mapping with the keys {', '.join(Scene.model_fields)}")
    try:
        return Scene.model_validate(data)
    except ValidationError as error:
        raise SceneError(f"{source}: {describe(error)}") from None


def describe(error: ValidationError) -> str:
    """Say in one line what is wrong with a scene.

    Args:
        error: what `Scene.model_validate` raised.

    Returns:
        The first mistake, unknown keys before all others, and how many more there are.
    """
    mistakes = error.errors(include_url=False)
    mistakes.sort(key=lambda m: m["type"] != "extra_forbidden")
    more = f" (and {len(mistakes) - 1} more)" if len(mistakes) > 1 else ""
    return _describe_one(mistakes[0]) + more


def _describe_one(mistake: ErrorDetails) -> str:
    path = [str(p) for p in mistake["loc"] if not str(p).startswith(("function-", "FrictionRowsPart", "float"))]
    where = ".".join(path)
    if mistake["type"] == "extra_forbidden":
        known = _known_keys(path[:-1])
        nearest = difflib.get_close_matches(path[-1], known, n=1, cutoff=0.0)
        return f"{where}: unknown key; the nearest known key is {nearest[0]!r}" if nearest else f"{where}: unknown key"
    if mistake["type"] == "missing":
        return f"{where}: missing"
    text = mistake["msg"].removeprefix("Value error, ")
    if text.startswith(("body.", "friction.", "start.", "drive.", "dimension")):
        return text
    return f"{where}: {text}" if where else text


def _known_keys(path: list[str]) -> Iterable[str]:
    model: type[BaseModel] = Scene
    parts: dict[str, type[BaseModel]] = {
        "body": BodyPart,
        "links": LinksPart,
        "friction": FrictionRowsPart if "drive" in path else FrictionPart,
        "start": StartPart,
        "drive": DrivePart,
        "wave": WavePart,
        "friction_wave": WavePart,
    }
    if path:
        model = parts.get(path[-1], Scene)
    return model.model_fields


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
            return parse_scene(path.read_text(encoding="utf-8"), text)
        except (OSError, UnicodeDecodeError) as error:
            raise SceneError(f"{text}: cannot be read: {error}") from None
    known = gallery()
    if text in known:
        file = resources.files("msgs_config") / "scenes" / f"{text}.yaml"
        return parse_scene(file.read_text(encoding="utf-8"), text)
    if path.suffix or len(path.parts) > 1:
        raise SceneError(f"{text}: no such file")
    nearest = difflib.get_close_matches(text, known, n=1, cutoff=0.5)
    hint = f"the nearest is {nearest[0]!r}" if nearest else f"there are {', '.join(known)}"
    raise SceneError(f"{text}: no such file, nor a scene of the gallery; {hint}")
