"""The mutants of `gcs/safety`, as cosmic-ray makes them."""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from difflib import unified_diff
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast_from_path
from cosmic_ray.plugins import get_operator
from parso.tree import NodeOrLeaf

PACKAGE = Path("gcs/safety")
LEFT_OUT = ("__init__.py",)
"""`kernels` only calls what flight calls later, so that it is compiled by then; here nothing is compiled."""

BINARY = (
    "Add_Sub",
    "Sub_Add",
    "Mul_Div",
    "Div_Mul",
    "FloorDiv_Mul",
    "Mod_Mul",
    "Pow_Mul",
    "BitAnd_BitOr",
    "BitOr_BitAnd",
)
COMPARISON = (
    *("Lt_LtE", "Lt_GtE", "LtE_Lt", "LtE_Gt", "Gt_GtE", "Gt_LtE", "GtE_Gt", "GtE_Lt"),
    *("Eq_NotEq", "NotEq_Eq"),
)
OPERATORS = (
    *(f"ReplaceBinaryOperator_{name}" for name in BINARY),
    *(f"ReplaceComparisonOperator_{name}" for name in COMPARISON),
    *(
        "ReplaceUnaryOperator_Delete_USub",
        "ReplaceUnaryOperator_Delete_Not",
        "ReplaceUnaryOperator_Delete_Invert",
    ),
    *("ReplaceAndWithOr", "ReplaceOrWithAnd", "ReplaceTrueWithFalse", "ReplaceFalseWithTrue", "AddNot"),
    *("ReplaceBreakWithContinue", "ReplaceContinueWithBreak", "ZeroIterationForLoop", "NumberReplacer"),
)
"""What is left out: docs/mutation.md."""


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change of one place, in cosmic-ray's words."""

    file: str
    operator: str
    occurrence: int
    start: tuple[int, int]  # line, column


@dataclass(frozen=True, slots=True)
class Change:
    """What a mutant does to the text: found again wherever the lines have gone meanwhile."""

    file: str
    function: str  # with its class; "" outside of all
    was: str
    nth: int  # of the lines of the function that read like this, from 1
    becomes: str


def mutants_of(file: str) -> Iterator[Mutant]:
    """Every mutant of a module, except of its decorators and annotations."""
    tree = get_ast_from_path(Path(file))
    spared = list(_spared(Path(file).read_text(encoding="utf-8")))
    for name in OPERATORS:
        operator = get_operator(f"core/{name}")()
        places = ((node, place) for node in ast_nodes(tree) for place in operator.mutation_positions(node))
        for occurrence, (node, (start, _)) in enumerate(places):
            if not (_ends_positional(node) or any(low <= start < high for low, high in spared)):
                yield Mutant(file, f"core/{name}", occurrence, tuple(start))


def _ends_positional(node: NodeOrLeaf) -> bool:
    """Whether it is the star after which parameters are passed by name."""
    return bool(node.get_code().strip() == "*" and node.get_next_leaf().get_code().strip() == ",")


Span = tuple[tuple[int, int], tuple[int, int]]


def _spared(source: str) -> Iterator[Span]:
    """From where to where decorators, annotations and `warm_up` go: (line, column), without the end."""
    for node in ast.walk(ast.parse(source)):
        spared: list[ast.expr | ast.stmt | None] = []
        if isinstance(node, ast.FunctionDef) and node.name == "warm_up":
            spared.append(node)
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            spared += node.decorator_list
        if isinstance(node, ast.FunctionDef):
            spared.append(node.returns)
        if isinstance(node, ast.arg | ast.AnnAssign):
            spared.append(node.annotation)
        for part in spared:
            if part is not None:
                yield (part.lineno, part.col_offset), (part.end_lineno or 0, part.end_col_offset or 0)


def change(mutant: Mutant, was: str, becomes: str) -> Change:
    """What the difference between the two texts of the module says."""
    differing = [
        line
        for line in unified_diff(was.splitlines(), becomes.splitlines(), n=0)
        if not line.startswith(("---", "+++", "@@"))
    ]
    old, new = (
        " ".join(line[1:].split("  # ")[0].strip() for line in differing if line[0] == sign) for sign in "-+"
    )
    lines, place = was.splitlines(), mutant.start[0]
    first, last, function = _function(was, place)
    alike = [n for n in range(first, last + 1) if lines[n - 1].strip() == lines[place - 1].strip()]
    return Change(mutant.file, function, old, alike.index(place) + 1, new)


def _function(source: str, line: int) -> tuple[int, int, str]:
    """First and last line of the innermost function, or class, and its name."""
    inside = (1, len(source.splitlines()), "")
    pending: list[tuple[ast.AST, str]] = [(ast.parse(source), "")]
    while pending:
        node, path = pending.pop()
        for child in ast.iter_child_nodes(node):
            if not isinstance(child, ast.FunctionDef | ast.ClassDef):
                continue
            if child.lineno <= line <= (child.end_lineno or 0):
                name = f"{path}.{child.name}".lstrip(".")
                inside = (child.lineno, child.end_lineno or 0, name)
                pending.append((child, name))
    return inside
