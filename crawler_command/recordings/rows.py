"""One recording as rows of a data set: its run, cycles, slips and energy account, with the same columns for all."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet

import crawler_model
from crawler_model import CrawlerError, Scene
from crawler_model.body.drive import NS
from crawler_ros.recording.bag import find_files
from crawler_ros.replay import Replay, analyse
from crawler_ros.replay.cycle_table import EnergyBalance, account_of
from crawler_ros.replay.show.tables import cycles_table, slips_table

from ..units import unit_of

TABLES = ("cycles", "slips", "account", "runs")
"""The tables of a data set; a recording is finished as soon as it has its row of `runs`, which is written last."""
IDENTITY = b"crawler_recording"
"""Key in the metadata of a row of `runs`: which file it describes, and what the analysis depended on."""
_LAYOUT = 3
_MOST_NUMBERS = 16
"""Longer lists of a scene have no columns."""
_RUNS = {
    **dict.fromkeys(("scene", "method", "namespace", "recording", "version"), (pa.string(), "1")),
    "size": (pa.int64(), "B"),
    "modified": (pa.timestamp("us"), "1"),
    "messages": (pa.int64(), "1"),
    "duration": (pa.float64(), "s"),
    "resets": (pa.int32(), "1"),
    "healthy": (pa.bool_(), "1"),
    "problems": (pa.string(), "1"),
    **dict.fromkeys(("missing", "out_of_order", "duplicates", "compared"), (pa.int64(), "1")),
    "identical": (pa.bool_(), "1"),
    "max_difference": (pa.float64(), "1"),
    "first_difference": (pa.float64(), "s"),
    "explanation": (pa.string(), "1"),
    **dict.fromkeys(("translation", "translation_y"), (pa.float64(), "m")),
    "turned": (pa.float64(), "rad"),
    **dict.fromkeys(("cycles", "transient_cycles"), (pa.int32(), "1")),
    "cycle_source": (pa.string(), "1"),
    "speed": (pa.float64(), "m/s"),
    "cost_of_transport": (pa.float64(), "1"),
    **dict.fromkeys(("slack", "stalled"), (pa.float64(), "s")),
    **dict.fromkeys(("slips", "jumps"), (pa.int64(), "1")),
    "least_margin": (pa.float64(), "N"),
    "least_margin_at": (pa.float64(), "s"),
    "least_margin_contact": (pa.string(), "1"),
    "visited_margin": (pa.float64(), "1"),
    "unique": (pa.bool_(), "1"),
    "stability_margin": (pa.float64(), "1"),
    "stability_time": (pa.float64(), "s"),
}
_LENGTHS = ("translation", "translation_y", "slip_forward", "slip_backward")
_ACCOUNT = {
    "reset": (pa.int32(), "1"),
    **dict.fromkeys(("start", "end"), (pa.float64(), "s")),
    **dict.fromkeys(_LENGTHS, (pa.float64(), "m")),
    "turned": (pa.float64(), "rad"),
    **{f.name: (pa.float64(), "1" if f.name == "residual" else "J") for f in fields(EnergyBalance)},
}


@dataclass(frozen=True)
class Identity:
    """The files that a row describes, and what else its analysis depended on.

    Attributes:
        recording: absolute path of the first one.
        size: their size [B].
        modified_ns: when the newest was modified [ns].
        digest: of their contents.
        settings: of `--scene`, `--namespace` and the version of the analysis.
    """

    recording: str
    size: int
    modified_ns: int
    digest: str
    settings: str


@dataclass(frozen=True)
class Outcome:
    """What became of a recording.

    Attributes:
        tables: for each table its Parquet file; none when the recording is skipped.
        reason: why it is skipped; empty when it is not.
        healthy: whether the analysis found no problem.
    """

    tables: Mapping[str, bytes]
    reason: str
    healthy: bool


def describe_settings(scene: Mapping[str, Any] | None, namespace: str | None) -> str:
    """Describe what the rows of a recording depend on besides its file.

    Args:
        scene: the document of `--scene`.
        namespace: of `--namespace`.

    Returns:
        A short text, equal for equal settings.
    """
    settings = json.dumps([_LAYOUT, crawler_model.__version__, scene, namespace], sort_keys=True)
    return hashlib.blake2b(settings.encode(), digest_size=16).hexdigest()


def describe_files(bag: Path) -> tuple[str, int, int]:
    """Describe the files of a recording without reading them.

    Args:
        bag: its bag folder or .mcap file.

    Returns:
        The path of the first one, the size of all [B], and when the newest was modified [ns].
    """
    files = find_files(bag)
    about = [file.stat() for file in files]
    newest = max(one.st_mtime_ns for one in about)
    return text_of(files[0].resolve()), sum(one.st_size for one in about), newest


def digest_of(bag: Path) -> str:
    """Compute a digest of the contents of a recording.

    Args:
        bag: its bag folder or .mcap file.

    Returns:
        Hexadecimal digits.
    """
    found = hashlib.blake2b(digest_size=16)
    for file in find_files(bag):
        with file.open("rb") as stream:
            while piece := stream.read(1 << 20):
                found.update(piece)
    return found.hexdigest()


def tabulate(bag: str, scene: Mapping[str, Any] | None, namespace: str | None) -> Outcome:
    """Analyse a recording; this function runs in worker processes, which write nothing.

    Args:
        bag: absolute path of the bag folder or .mcap file.
        scene: document of the scene that ran, for a recording that does not hold it.
        namespace: namespace of the crawler, where several were recorded.

    Returns:
        Its tables, or why it is skipped.
    """
    path = Path(bag)
    try:
        described = describe_files(path)
        digest = digest_of(path)
        replay = analyse(path, None if scene is None else Scene.model_validate(scene), namespace)
        if not replay.survey.complete:
            return Outcome({}, replay.problems[0], False)
        settings = describe_settings(scene, namespace)
        identity = Identity(*described, digest, settings)
        tables = {name: _serialise(table) for name, table in _build_tables(replay, identity).items()}
    except ModuleNotFoundError:
        raise
    except (CrawlerError, OSError) as error:
        return Outcome({}, str(error).removeprefix(f"{path}: "), False)
    except Exception as error:  # whatever damaged bytes cause: the other recordings are to be analysed
        return Outcome({}, f"damaged: {type(error).__name__}: {error}", False)
    return Outcome(tables, "", replay.healthy)


def text_of(path: Path) -> str:
    """Convert a path to text that can be stored, even if its name is not valid UTF-8.

    Args:
        path: the path.

    Returns:
        The text.
    """
    return os.fsencode(path).decode(errors="replace")


def _serialise(table: pa.Table) -> bytes:
    sink = pa.BufferOutputStream()
    parquet.write_table(table, sink, compression="zstd")
    return sink.getvalue().to_pybytes()


def _build_tables(replay: Replay, identity: Identity) -> dict[str, pa.Table]:
    cycles = _renamed(cycles_table(replay), {"run": "reset", "translation_x": "translation"})
    cycles = _with_column(cycles, "translation_y", "m", cycles.column_names.index("translation") + 1)
    slips = _renamed(slips_table(replay), {"run": "reset"})
    at = slips.column_names.index("contact")
    contact = pa.field("contact", pa.string(), metadata=slips.schema.field(at).metadata)
    return {
        "cycles": _with_column(cycles, "turned", "rad", cycles.num_columns),
        "slips": slips.set_column(at, contact, slips["contact"].cast(pa.string())),
        "account": _rows(list(_account(replay)), _ACCOUNT),
        "runs": _build_run(replay, identity),
    }


def _renamed(table: pa.Table, names: Mapping[str, str]) -> pa.Table:
    return table.rename_columns([names.get(name, name) for name in table.column_names])


def _with_column(table: pa.Table, name: str, unit: str, at: int) -> pa.Table:
    """Add a column that other bodies have, unknown."""
    if name in table.column_names:
        return table
    return table.add_column(
        at, pa.field(name, pa.float64(), metadata={"unit": unit}), pa.nulls(table.num_rows, pa.float64())
    )


def _rows(rows: list[dict[str, Any]], columns: Mapping[str, tuple[Any, str]]) -> pa.Table:
    schema = pa.schema([pa.field(name, kind, metadata={"unit": unit}) for name, (kind, unit) in columns.items()])
    arrays = [pa.array([row[f.name] for row in rows], f.type, from_pandas=True) for f in schema]
    return pa.Table.from_arrays(arrays, schema=schema)


def _account(replay: Replay) -> Iterator[dict[str, Any]]:
    """Build a row for each stretch between resets."""
    table = replay.table
    for reset in np.unique(table.run).tolist():
        at = np.flatnonzero(table.run == reset)
        first, last = int(at[0]), int(at[-1])
        inside = slice(first + 1, last + 1)
        known = None if replay.comparison is None else account_of(table, first, last)
        slid = (float(table.forward[inside].sum()), float(table.backward[inside].sum()))
        gained = _two_axes(table.net_translation[last] - table.net_translation[first])
        yield {
            "reset": reset,
            "start": float(table.end_ns[first]) / NS,
            "end": float(table.end_ns[last]) / NS,
            **dict(zip(_LENGTHS, (*gained, *slid), strict=True)),
            "turned": float(table.yaw[last] - table.yaw[first]) if table.turns else None,
            **{f.name: None if known is None else getattr(known, f.name) for f in fields(EnergyBalance)},
        }


def _two_axes(vector: np.ndarray) -> tuple[float, float | None]:
    return float(vector[0]), float(vector[1]) if vector.size > 1 else None


def _build_run(replay: Replay, identity: Identity) -> pa.Table:
    """Build the row of `runs`, with a column for each number of the scene."""
    scene = replay.scene
    numbers = {} if scene is None else dict(_numbers_in(scene.document(), ""))
    units = {} if scene is None else {name: (pa.float64(), unit_of(scene, name)) for name in numbers}
    row = {**_describe_file(replay, identity), **_describe_health(replay), **_describe_motion(replay), **numbers}
    return _rows([row], {**_RUNS, **units}).replace_schema_metadata({IDENTITY: json.dumps(asdict(identity))})


def _numbers_in(node: Any, key: str) -> Iterator[tuple[str, float]]:
    """Find the real numbers of a scene's document by their keys, as `crawler sweep --vary` takes them."""
    if isinstance(node, float):
        yield key, node
    elif isinstance(node, dict):
        for name, inside in node.items():
            yield from _numbers_in(inside, f"{key}.{name}" if key else name)
    elif isinstance(node, list) and all(isinstance(part, dict) and "name" in part for part in node):
        for part in node:
            yield from _numbers_in(part, f"{key}.{part['name']}")
    elif isinstance(node, list):
        inner = [pair for i, part in enumerate(node) for pair in _numbers_in(part, f"{key}[{i}]")]
        if len(inner) <= _MOST_NUMBERS:
            yield from inner


def _describe_file(replay: Replay, identity: Identity) -> dict[str, Any]:
    versions = replay.survey.attachments.get("versions")
    return {
        "scene": None if replay.scene is None else replay.scene.name,
        "method": replay.method,
        "namespace": replay.robot.namespace,
        "recording": identity.recording,
        "version": str(versions.get("crawler")) if isinstance(versions, dict) else None,
        "size": identity.size,
        "modified": datetime.fromtimestamp(identity.modified_ns / NS, timezone.utc).replace(tzinfo=None),
        "messages": replay.survey.messages,
    }


def _describe_health(replay: Replay) -> dict[str, Any]:
    again = replay.as_plain()["resimulation"]
    topics = replay.topics.values()
    known = replay.comparison is not None
    return {
        "resets": int(replay.table.run.max(initial=0)),
        "healthy": replay.healthy,
        "problems": "; ".join(replay.problems) or None,
        "missing": sum(topic.missing for topic in topics),
        "out_of_order": sum(topic.out_of_order for topic in topics),
        "duplicates": sum(topic.duplicates for topic in topics),
        "compared": again["ticks"],
        "identical": again["identical"] if known else None,
        **{name: again[name] for name in ("max_difference", "first_difference", "explanation")},
    }


def _describe_motion(replay: Replay) -> dict[str, Any]:
    gained = list(_account(replay))
    margins, last = replay.margins, replay.cycles[-1] if replay.cycles else None
    planar = replay.table.net_translation.shape[1] == 2
    return {
        "duration": replay.seconds,
        "translation": sum(row["translation"] for row in gained),
        "translation_y": sum(row["translation_y"] for row in gained) if planar else None,
        "turned": sum(row["turned"] for row in gained) if replay.table.turns else None,
        "cycles": len(replay.cycles),
        "transient_cycles": sum(cycle.transient for cycle in replay.cycles),
        "cycle_source": replay.cycle_source,
        "speed": None if last is None else last.speed,
        "cost_of_transport": None if last is None else last.cost_of_transport,
        **{name: _seconds(replay, name) for name in ("slack", "stalled")},
        "slips": int(replay.slips.contact.size),
        "jumps": len(replay.table.jumps),
        "least_margin": None if margins is None else margins.least,
        "least_margin_at": None if margins is None else margins.least_at,
        "least_margin_contact": None if margins is None else margins.least_contact,
        "visited_margin": None if margins is None else margins.visited,
        "unique": None if margins is None else margins.unique,
        "stability_margin": None if margins is None else margins.stability_margin,
        "stability_time": None if margins is None else margins.stability_time,
    }


def _seconds(replay: Replay, state: str) -> float | None:
    """How long links were slack, or stalled, all of them together [s]."""
    return None if replay.at_limits is None else sum(found.get(state, 0.0) for found in replay.at_limits.values())
