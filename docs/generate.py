"""Generate what is derived: the JSON schema of scene files, the pages in docs/reference, and copies of the lessons."""

from __future__ import annotations

import ast
import csv
import inspect
import json
import re
import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from enum import Enum
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import yaml
from typer.models import ArgumentInfo

import crawler_lab
import crawler_model
import crawler_ros.replay
from crawler_command.app import app
from crawler_model.scene.parts import SceneParts
from crawler_ros.node.parameters import read_parameters

ROOT = Path(__file__).parent.parent
REFERENCE = ROOT / "docs" / "reference"

_DEPTHS = ("number", "list of numbers", "list of lists", "list of lists of lists")
_TAKEN = {bool: "", str: "text", int: "whole number", float: "number", Path: "path"}
_OTHER_NODES = {
    "crawler-gait-player": "crawler_ros/node/gait_player.py",
    "crawler-speed-control": "crawler_ros/examples/speed_control.py",
    "crawler-phase-control": "crawler_ros/examples/phase_control.py",
    "crawler-path-control": "crawler_ros/examples/path_control.py",
    "each of these three": "crawler_ros/examples/periods.py",
    "crawler-policy": "crawler_lab/gym/policy_node.py",
    "crawler-plan": "crawler_lab/plan/plan_node.py",
}

_SCENES = """# Scene files: every key

Units are SI. A list whose entries are all equal may be written as one number; a key with a default may be left out. For
the purpose of the parts, with examples, see [Scenes](../scenes.md). For editors,
[scene.schema.json](../../msgs_config/scene.schema.json) has the same content.

"""
_TOPICS = """# Topics and services

Generated from [topics.yaml](../../msgs_config/topics.yaml), from which the node also creates its publishers,
subscriptions and recordings. Names without a leading `/` are relative: a namespace separates one crawler from another.

In the plane every joint and contact has `/x` and `/y`, but links and joints of a body that turns have one entry each. A
segment along which a wave runs has a name for each element (`trunk/element_3`, `trunk/contact_3/forward`). Messages are
stamped with the simulated time of the end of the tick,
except `applied_commands`, which is stamped with its start. Messages of a wrong length, with NaN or with negative
friction are refused as a whole, logged and counted in `/diagnostics`.

## Commands

{commands}\
## States

{states}\
## Quality of service

Parameters `qos_overrides./TOPIC.publisher.*` (states) and `.subscription.*` (commands) of the simulator change
`reliability`, `depth` and `history` of a topic.

{qos}\
## Services

The node is called `crawler`.

{services}"""
_PARAMETERS = """# Parameters

Parameters are set with `--ros-args -p NAME:=VALUE`; a `double` is written with a decimal point.

## crawler-simulator

Generated from [simulator.yaml](../../msgs_config/simulator.yaml). Parameters marked in the column *at run time* can be
changed while the node runs; a change of any other is refused with a reason.

{simulator}\
For the parameters of the quality of service, `qos_overrides./TOPIC...`, see [the topics](topics.md#quality-of-service).

## The other nodes

The gait player plays the drive of `scene`, `periods` times (0: without end). For the parameters of the controllers see
[their description](../controllers.md#three-controllers-to-copy), for the policy's [Learn a gait](../learn.md), for
the plan's [A controller that plans](../controllers.md#a-controller-that-plans).

{others}"""
_COMMAND = """# The crawler command

Exit status 0 means success; 1 an error, with one line on standard error that names the problem, its place and what
would be right; 2 a wrong command line; 130 an interrupt. Long work shows its progress on a terminal, but not in a pipe.
`crawler VERB --help` prints the content of this page, `crawler --version` the version, and `crawler
--install-completion` makes your shell complete verbs and options.

An existing file is replaced only with `--force`. `--rate` is a frequency, `--duration` simulated time and `--seconds`
time on the clock, in every verb.

"""
_HARD_CASES = """# Hard cases

Other simulators of dry friction fail in these cases. Each is run on every body and with every method to which it
applies; the result must be exact within rounding, or the difficulty must be reported
(`tests/instrument/model/test_hard_cases.py`). [hard-cases.csv](hard-cases.csv) has the {cases} rows that
`python docs/hard_cases.py` measured, with bodies, methods, times and what each is compared with; cases that differ in
numbers are one row here.

* `unique: False`: friction leaves the translation undetermined; compared are the shape and the rule for it.
* Errors are in m on bodies of about 1 m and 1 N, or relative; within a tolerance or accuracy they are divided by it,
  and where the certificate shows them by what it admits.
* Chains are compared with rational arithmetic, graphs with the chain, the plane with the body on a line.

"""
_GALLERY = """# Gallery

The bodies that come with the program. `crawler simulate NAME` runs one, `crawler play NAME` lets you drive it,
`crawler animate NAME --out film.gif` makes a film; each is a file in `msgs_config/scenes` to start from
([Scenes](scenes.md)). Green contacts slide forward, red ones back, grey ones hold. [The paper,
figure by figure](tutorial.md) shows the forces of some of them.

"""
_PYTHON = """# Python

The public names of `crawler_model`, `crawler_lab` and `crawler_ros.replay`. The docstring of each name, in the file to
which it is linked, describes arguments, shapes, units, errors and the source; the site that `make docs` builds shows
the docstrings below. Arrays are float64 and read-only; units are SI throughout.

"""


def table(*columns: str, rows: Iterable[Iterable[str]]) -> str:
    """Format a table in Markdown.

    Args:
        *columns: the cells of its header.
        rows: its cells, row by row; columns whose cells are all empty are omitted.

    Returns:
        The table, followed by an empty line.
    """
    cells = [[" ".join(cell.split()).replace("|", "\\|") for cell in row] for row in rows]
    kept = [k for k in range(len(columns)) if any(row[k] for row in cells)]
    lines = [[columns[k] for k in kept], ["---"] * len(kept), *([row[k] for k in kept] for row in cells)]
    return "".join("|" + "|".join(f" {cell} " if cell else " " for cell in line) + "|\n" for line in lines) + "\n"


def code(value: Any) -> str:
    """Format a value as code in YAML syntax; empty for None."""
    return "" if value is None else f"`{value if isinstance(value, str) else json.dumps(value)}`"


def paragraphs(thing: Any) -> list[str]:
    """Split a docstring into paragraphs, each on one line."""
    return [" ".join(paragraph.split()) for paragraph in (inspect.getdoc(thing) or "").split("\n\n")]


def wrapped(text: str) -> str:
    """Break a paragraph into lines."""
    return textwrap.fill(text, 150, break_long_words=False, break_on_hyphens=False)


def schema() -> str:
    """Return the scene schema as the text of its file."""
    return json.dumps(SceneParts.model_json_schema(), indent=2) + "\n"


def scenes() -> str:
    """Write the reference of every key of a scene file, from its schema."""
    root = SceneParts.model_json_schema()
    parts = root["$defs"]
    places: dict[str, list[str]] = {}
    _find_parts(root, "", parts, places)
    named = {"TablePart": "Tables along a segment", "LinkPart": "Entries of body.links"}
    headings = {name: named.get(name, ", ".join(at)) for name, at in places.items()}
    anchors = {name: re.sub(r"[^\w-]", "", text.lower().replace(" ", "-")) for name, text in headings.items()}
    seen: dict[tuple[str, ...], str] = {}
    text = _SCENES + "## The file\n\n" + _keys(root, anchors, "The file", seen)
    for name, heading in headings.items():
        text += f"## {heading}\n\n{parts[name]['description']}\n\n{_keys(parts[name], anchors, heading, seen)}"
    return text


def _find_parts(part: Any, path: str, parts: dict[str, Any], places: dict[str, list[str]]) -> None:
    """Collect the keys at which each part of the schema occurs, in reading order."""
    for key, value in part["properties"].items():
        for name in re.findall(r'"#/\$defs/(\w+)"', json.dumps(value)):
            where = f"{path}.{key}" if path else key
            if where not in places.setdefault(name, []):
                places[name].append(where)
                _find_parts(parts[name], where, parts, places)


def _keys(part: dict[str, Any], anchors: dict[str, str], heading: str, seen: dict[tuple[str, ...], str]) -> str:
    """Write the table of a part; a meaning that an earlier part has is not repeated."""
    rows = []
    for key, value in part["properties"].items():
        default = "required" if key in part.get("required", ()) else code(value.get("default"))
        kind = ", ".join(_kinds(value, anchors))
        meaning, unit = value["description"], value.get("unit", "")
        before = seen.setdefault((key, unit, meaning), heading)
        if before != heading and len(meaning.split()) > 8:
            meaning = f"As in {before}."
        rows.append((code(key), kind, unit, default, _range(value), meaning))
    return table("key", "type", "unit", "default", "range", "meaning", rows=rows)


def _depths(value: dict[str, Any]) -> set[int]:
    """Return the depths at which numbers may be nested in lists; empty for values without numbers."""
    if "anyOf" in value:
        return set().union(*(_depths(other) for other in value["anyOf"]))
    if value.get("type") == "array" and "items" in value:
        return {1 + depth for depth in _depths(value["items"])}
    return {0} if value.get("type") == "number" else set()


def _kinds(value: dict[str, Any], anchors: dict[str, str]) -> list[str]:
    """List the types of value that a key accepts."""
    found = [_DEPTHS[depth] for depth in sorted(_depths(value))]
    choices = [one for other in value.get("anyOf", [value]) for one in other.get("oneOf", [other])]
    for other in choices:
        if _depths(other) or other.get("type") == "null":
            continue
        if "$ref" in other:
            found.append(f"[mapping](#{anchors[other['$ref'].split('/')[-1]]})")
        elif "enum" in other or "const" in other:
            found += [code(choice) for choice in other.get("enum", [other.get("const")])]
        elif "prefixItems" in other:
            found.append("pair" if len(other["prefixItems"]) == 2 else "triple")
        elif other["type"] == "array":
            inner = other["items"]
            found.append(f"list of {_kinds(inner, anchors)[0]}s")
        else:
            found.append({"string": "text", "integer": "whole number"}[other["type"]])
    return found


def _range(value: dict[str, Any]) -> str:
    least, above, most = (value.get(key) for key in ("minimum", "exclusiveMinimum", "maximum"))
    if most is not None:
        return f"{_number(least)} .. {_number(most)}"
    return f">= {_number(least)}" if least is not None else f"> {_number(above)}" if above is not None else ""


def _number(value: Any) -> str:
    return f"{value:_}".replace("_", " ") if isinstance(value, int) else f"{value:g}".replace("e-0", "e-")


def topics() -> str:
    """Write the reference of every topic and service, from msgs_config/topics.yaml."""
    given = yaml.safe_load((ROOT / "msgs_config" / "topics.yaml").read_text(encoding="utf-8"))
    parts = {"in": "", "out": ""}
    for name, row in given["topics"].items():
        line = f"{code(row['type'])}; quality of service: [{row['qos']}](#quality-of-service)"
        line += "".join(f"; {key}: {row[key]}" for key in ("unit", "frame") if key in row)
        parts[row["direction"]] += f"### {name}\n\n{line}\n\n{wrapped(row['meaning'])}\n\n"
    keys = ("reliability", "durability", "history", "depth")
    qos = table("name", *keys, rows=((n, *(str(row[key]) for key in keys)) for n, row in given["qos"].items()))
    rows = ((code(f"crawler/{n}"), row["type"], row["meaning"]) for n, row in given["services"].items())
    text = _TOPICS.format(
        commands=parts["in"], states=parts["out"], qos=qos, services=table("service", "type", "meaning", rows=rows)
    )
    return re.sub(r"(?<=_msgs|_srvs)/(msg|srv)/", "/", text)


def parameters() -> str:
    """Write the reference of the parameters of all nodes, the simulator's from msgs_config/simulator.yaml."""
    rows = []
    for row in read_parameters().values():
        bounds = " .. ".join(f"{bound:g}" for bound in row.range) if row.range else ", ".join(map(code, row.choices))
        default = "(empty)" if row.default == "" else code(row.default)
        rows.append((code(row.name), row.type, default, bounds, "yes" if row.runtime else "", row.meaning))
    simulator = table("parameter", "type", "default", "range", "at run time", "meaning", rows=rows)
    found = (
        (code(node) if node[:8] == "crawler-" else node, *pair)
        for node, file in _OTHER_NODES.items()
        for pair in declared(ROOT / file)
    )
    others = table("node", "parameter", "default", rows=((a, code(b), code(c)) for a, b, c in found))
    return _PARAMETERS.format(simulator=simulator, others=others)


def declared(file: Path) -> list[tuple[str, Any]]:
    """Read the parameters that a node declares, without rclpy.

    Args:
        file: its source.

    Returns:
        Name and default of each, in order.
    """
    tree = ast.parse(file.read_text(encoding="utf-8"))
    values = {ast.unparse(n.targets[0]): n.value for n in tree.body if isinstance(n, ast.Assign)}
    calls = [
        n for n in ast.walk(tree) if isinstance(n, ast.Call) and getattr(n.func, "attr", "") == "declare_parameter"
    ]
    return [
        (ast.literal_eval(call.args[0]), ast.literal_eval(values.get(ast.unparse(call.args[1]), call.args[1])))
        for call in sorted(calls, key=lambda call: call.lineno)
    ]


def command() -> str:
    """Write the reference of every verb of the `crawler` command, from the functions behind the verbs."""
    verbs = {(verb.name or verb.callback.__name__): verb.callback for verb in app.registered_commands if verb.callback}
    text = _COMMAND
    text += table("verb", "does", rows=((f"[`{n}`](#crawler-{n})", paragraphs(verb)[0]) for n, verb in verbs.items()))
    options = {name: list(_options(verb)) for name, verb in verbs.items()}
    times = Counter(row for rows in options.values() for row in rows)
    shared = [row for row, count in times.items() if count > 2 and row[0].startswith("`--")]
    text += "## Options of several verbs\n\n" + table("option", "takes", "default", "meaning", rows=shared)
    for name, verb in verbs.items():
        text += f"## crawler {name}\n\n"
        for paragraph in paragraphs(verb):
            example = paragraph.startswith("crawler ")
            text += f"```bash\n{paragraph}\n```\n\n" if example else f"{wrapped(paragraph)}\n\n"
        own = [row for row in options[name] if row not in shared]
        text += table("argument or option", "takes", "default", "meaning", rows=own) if own else ""
        also = ", ".join(row[0] for row in options[name] if row in shared)
        text += f"Also {also}: [options of several verbs](#options-of-several-verbs).\n\n" if also else ""
    return text


def _options(verb: Callable[..., None]) -> Iterator[tuple[str, str, str, str]]:
    hints = get_type_hints(verb, include_extras=True)
    for name, parameter in inspect.signature(verb).parameters.items():
        kind, info = get_args(hints[name])
        kinds = [k for k in get_args(kind) if k is not type(None)] or [kind]
        several, one = get_origin(kinds[0]) is list, (get_args(kinds[0]) or kinds)[0]
        label = name.upper()
        if not isinstance(info, ArgumentInfo):
            given = [text for text in (info.default, *(info.param_decls or ())) if isinstance(text, str)]
            label = ", ".join(given) or f"--{name.replace('_', '-')}"
        takes = code(info.metavar) or _TAKEN.get(one, "")
        if issubclass(one, Enum):
            takes = ", ".join(code(choice.value) for choice in one)
        default = parameter.default
        if default is inspect.Parameter.empty:
            default = "required"
        else:
            default = "" if default in (None, False) else code(str(getattr(default, "value", default)))
        yield code(label), f"{takes}, several times" if several else takes, default, info.help or ""


def python() -> str:
    """Write the public names of three packages; docs/mkdocs_hook.py uses the link titles and the comments."""
    text = _PYTHON
    for package in (crawler_model, crawler_lab, crawler_ros.replay):
        rows = []
        modules = {name: getattr(package, name).__module__ for name in package.__all__}
        for name, module in modules.items():
            file = f"../../{module.replace('.', '/')}.py"
            rows.append((f'[`{name}`]({file} "{module}.{name}")', paragraphs(getattr(package, name))[0]))
        text += f"## {package.__name__}\n\n{paragraphs(package)[0]}\n\n{table('name', 'is', rows=rows)}"
        text += "".join(f"<!-- docstring of {module}.{name} -->\n\n" for name, module in modules.items())
    return text


def gallery() -> str:
    """Write the wall of the bodies in the gallery, whose pictures docs/bodies.py draws."""
    walls: dict[str, list[str]] = {"Feet and springs": [], "Segments": [], "Ground": [], "Plane": [], "Turning": []}
    for name, note in crawler_model.gallery().items():
        text = (ROOT / "msgs_config" / "scenes" / f"{name}.yaml").read_text(encoding="utf-8")
        walls[_kind(yaml.safe_load(text))].append(f"![{name}](pictures/bodies/{name}.png)<br>`{name}`: {note}")
    page = _GALLERY
    for title, cells in walls.items():
        rows = [[*cells[k : k + 3], "", ""][:3] for k in range(0, len(cells), 3)]
        page += f"## {title}\n\n{table(' ', '  ', '   ', rows=rows)}"
    return page


def hard_cases() -> str:
    """Write the page of the hard cases from their table, a row for all cases that differ in numbers only."""
    with (ROOT / "docs" / "hard-cases.csv").open(encoding="utf-8", newline="") as file:
        found = list(csv.DictReader(file))
    groups: dict[str, list[dict[str, str]]] = {}
    for row in found:
        groups.setdefault(re.sub(r"[-+]?\d[\d.e+-]*", "...", row["case"]), []).append(row)

    cells = []
    for name, rows in groups.items():
        worst = max((row["worst error"] for row in rows), key=float)
        cells.append((name, str(len(rows)), "; ".join(dict.fromkeys(row["verdict"] for row in rows)), worst))
    head = _HARD_CASES.format(cases=len(found))
    return head + table("case", "variants", "verdict", "worst error", rows=cells)


def _kind(scene: dict[str, Any]) -> str:
    if scene.get("dimension") == 2:
        return "Turning" if scene["body"].get("springs") == "length" else "Plane"
    if "ground" in scene or "with_elongation" in scene.get("friction", {}):
        return "Ground"
    return "Segments" if "segments" in scene["body"] else "Feet and springs"


def performance() -> str:
    """Write the table of mistakes into the page of the performance.

    Returns:
        The page.
    """
    page = (ROOT / "docs" / "performance.md").read_text(encoding="utf-8")
    found = json.loads((ROOT / "benchmarks" / "results" / "mistakes.json").read_text(encoding="utf-8"))
    columns = ("what is wrong", "robots of each", "called doubtful", "right explanation first")
    counts: dict[tuple[str, ...], list[str]] = {}
    for row in found["rows"]:
        counts.setdefault(tuple(str(row[key]) for key in ("robots", "doubtful", "first")), []).append(row["mistake"])
    rows = [("; ".join(mistakes), *key) for key, mistakes in counts.items()]
    robots, doubtful, first = (sum(row[key] for row in found["rows"]) for key in ("robots", "doubtful", "first"))
    rows.append(("all", str(robots), f"{doubtful / robots:.0%}", f"{first / doubtful:.0%} of the doubtful"))
    before, rest = page.split("<!-- mistakes -->\n\n")
    return before + "<!-- mistakes -->\n\n" + table(*columns, rows=rows) + rest[rest.index("\n\n") + 2 :]


FILES: dict[Path, Callable[[], str]] = {
    ROOT / "msgs_config" / "scene.schema.json": schema,
    ROOT / "docs" / "gallery.md": gallery,
    ROOT / "docs" / "hard-cases.md": hard_cases,
    ROOT / "docs" / "performance.md": performance,
    **{REFERENCE / f"{page.__name__}.md": page for page in (scenes, topics, parameters, command, python)},
}
"""The generated files, and the functions that generate them; each file ends with one newline."""


def generated() -> Iterator[tuple[Path, str]]:
    """Generate everything.

    Yields:
        Each file and its contents.
    """
    for file, write in FILES.items():
        yield file, write().rstrip("\n") + "\n"
    for page in sorted((ROOT / "crawler_lab" / "play" / "lessons").iterdir()):
        picture = f"![The page as this lesson opens it](../pictures/play/{page.stem}.png)"
        text = page.read_text(encoding="utf-8").replace("```\n\n1. ", f"```\n\n{picture}\n\n1. ", 1)
        yield ROOT / "docs" / "lessons" / page.name, text


if __name__ == "__main__":
    REFERENCE.mkdir(exist_ok=True)
    for file, text in generated():
        file.write_text(text, encoding="utf-8")
        print(f"written: {file.relative_to(ROOT)}")
