"""Small wrong changes of the code: which there are, and a choice that is spread over all rooms."""

from __future__ import annotations

import ast
import copy
import math
import random
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

KERNELS = {"compiled", "entry", "inner", "lean", "inlined"}
"""Decorators of kernels, see `crawler_model/compiled.py`."""
_PAIRS = "Lt GtE, Gt LtE, Eq NotEq, Is IsNot, In NotIn, Add Sub, Mult Div, BitAnd BitOr, And Or"
_OTHER = {a: b for pair in _PAIRS.split(", ") for a, b in (pair.split(), pair.split()[::-1])}
_OTHER |= {"FloorDiv": "Mult", "Mod": "Mult", "Pow": "Mult"}
_BORDER = {"Lt": "LtE", "LtE": "Lt", "Gt": "GtE", "GtE": "Gt"}
_NOT_NUMBERS = (ast.JoinedStr, ast.List, ast.Tuple, ast.Dict, ast.ListComp)


@dataclass
class Mutant:
    """A change of the text between two bytes of a file, and what became of it."""

    file: str
    line: int
    kind: str
    function: str
    kernel: bool
    before: str
    after: str
    place: tuple[int, int]
    fate: str = ""
    test: str = ""
    not_run: str = ""
    seconds: float = 0.0


def _is_number(node: ast.AST) -> bool:
    return type(node.value) in (int, float) if isinstance(node, ast.Constant) else not isinstance(node, _NOT_NUMBERS)


def _changes(node: ast.AST) -> Iterator[tuple[str, ast.AST, str]]:
    """List the changes of a node: their kind, the part that is replaced, and the text that replaces it."""

    def other(kind: str, names: dict[str, str] = _OTHER) -> Iterator[tuple[str, ast.AST, str]]:
        new = copy.deepcopy(node)
        name = names.get(type(new.ops[0] if isinstance(new, ast.Compare) else new.op).__name__)
        if name:
            new.op, new.ops = getattr(ast, name)(), [getattr(ast, name)()]
            yield kind, node, ast.unparse(new) if isinstance(node, ast.stmt) else f"({ast.unparse(new)})"

    match node:
        case ast.Compare(ops=[_]):
            yield from other("comparison")
            yield from other("border", _BORDER)
        case ast.BinOp(left=left, right=right) if _is_number(left) and _is_number(right):
            yield from other("arithmetic")
        case ast.BoolOp():
            yield from other("and, or")
        case ast.AugAssign(value=value):
            yield "dropped", node, "pass"
            if _is_number(value):
                yield from other("arithmetic")
        case ast.UnaryOp(op=ast.USub() | ast.Not(), operand=operand):
            yield "sign", node, f"({ast.unparse(operand)})"
        case ast.If(test=test) | ast.IfExp(test=test):
            yield "branch", test, "False"
        case ast.comprehension(ifs=[test, *_]):
            yield "branch", test, "True"
        case ast.Expr(value=ast.Call()) | ast.Raise() | ast.Continue() | ast.Break():
            yield "dropped", node, "pass"
        case ast.Constant(value=bool() as value):
            yield "constant", node, str(not value)
        case ast.Constant(value=int() | float() as value) if value in (0, 0.5, 1, 2):
            yield "constant", node, repr(value + 1)


def list_mutants(file: Path, root: Path) -> list[Mutant]:
    """List the mutants of a file, within functions: none of texts, types or default values."""
    data, found = file.read_bytes(), list[Mutant]()
    starts = [0]
    for line in data.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def visit(node: ast.AST, function: str, kernel: bool) -> None:
        children = list(ast.iter_child_nodes(node))
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            names = {getattr(d, "id", "") for d in node.decorator_list}
            function, kernel, children = node.name, kernel or bool(names & KERNELS), list(node.body)
        elif isinstance(node, (ast.JoinedStr, ast.arguments, ast.Raise)):
            children = []
        elif isinstance(node, ast.AnnAssign):
            children = [node.value] if node.value else []
        for kind, part, after in _changes(node) if function else ():
            place = starts[part.lineno - 1] + part.col_offset, starts[part.end_lineno - 1] + part.end_col_offset
            where = str(file.relative_to(root)), part.lineno, kind, function, kernel
            found.append(Mutant(*where, data[slice(*place)].decode(), after, place))
        for child in children:
            visit(child, function, kernel)

    visit(ast.parse(data), "", False)
    return found


def choose(root: Path, count: int, seed: int, packages: str) -> list[Mutant]:
    """Choose mutants: in each of equal parts of a package's mutants a kind, then one of this kind.

    The number of parts grows with the root of the package's size.
    """
    rng, chosen, share = random.Random(seed), list[Mutant](), 0.0
    folders = [f.parent for f in sorted(root.glob("crawler_*/__init__.py")) if re.fullmatch(packages, f.parent.name)]
    mutants = [[m for file in sorted(folder.rglob("*.py")) for m in list_mutants(file, root)] for folder in folders]
    for those in mutants:
        before, share = share, share + count * math.sqrt(len(those)) / sum(math.sqrt(len(m)) for m in mutants)
        parts = round(share) - round(before)
        for k in range(parts):
            part = those[k * len(those) // parts : (k + 1) * len(those) // parts]
            kind = rng.choice(sorted({m.kind for m in part}))
            chosen.append(rng.choice([m for m in part if m.kind == kind]))
    return chosen
