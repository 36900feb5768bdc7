"""The import graph of gcs: figures, and a drawing with one box per package, every import pointing down.

python -m tests.bench.import_graph [ROOT] [--svg FILE]
"""

import argparse
import ast
import sys
from collections import defaultdict
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Final

BOX: Final = (150, 34, 70, 80)
"""Width, height, gap between boxes, gap between levels; pixels."""

Graph = dict[str, set[str]]


def modules(root: Path) -> dict[str, Path]:
    """Every module of ours by its name; `api` and `sim` are packages of gcs."""
    found = {}
    for top in ("gcs", "api", "sim"):
        for path in sorted((root / top).rglob("*.py")):
            parts = [*(() if top == "gcs" else ("gcs",)), *path.relative_to(root).with_suffix("").parts]
            if "console" not in parts and parts[:3] not in (["gcs", "gcs", "api"], ["gcs", "gcs", "sim"]):
                found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def package_graph(root: Path) -> Graph:
    """What each package, or module that lies flat in gcs, imports of the others."""
    found, graph = modules(root), defaultdict(set)
    for name, path in found.items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                targets = [each.name for each in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                targets = [f"{node.module}.{each.name}" for each in node.names]
                targets = [each if each in found else node.module for each in targets]
            else:
                continue
            for target in targets:
                if name.count(".") and target in found and target.count("."):
                    graph[name.split(".")[1]].add(target.split(".")[1])
                    graph[target.split(".")[1]] |= set()
    return {name: others - {name} for name, others in graph.items()}


def levels(graph: Graph) -> list[list[str]]:
    """The lowest first: a package lies one above the highest that it imports. Raises: CycleError."""
    level: dict[str, int] = {}
    for name in TopologicalSorter(graph).static_order():
        level[name] = 1 + max((level[each] for each in graph[name]), default=-1)
    return [sorted(name for name in level if level[name] == row) for row in range(max(level.values()) + 1)]


def svg(graph: Graph) -> str:
    """The drawing."""
    width, height, gap, rise = BOX
    rows = levels(graph)[::-1]
    total = max(len(row) for row in rows) * (width + gap) + gap
    place = {}
    for y, row in enumerate(rows):
        start = (total - len(row) * (width + gap) + gap) / 2
        for x, name in enumerate(row):
            place[name] = (start + x * (width + gap), 16 + y * (height + rise))
    deep = len(rows) * (height + rise)
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {total:g} {deep:g}" font-size="14">',
        "<style>text { font-family: sans-serif }</style>",
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    edges = [(name, other) for name, others in sorted(graph.items()) for other in sorted(others)]
    leaves = {
        name: sorted((edge for edge in edges if edge[0] == name), key=lambda edge: place[edge[1]])
        for name in graph
    }
    enters = {
        name: sorted((edge for edge in edges if edge[1] == name), key=lambda edge: place[edge[0]])
        for name in graph
    }
    for name, other in edges:
        (x1, y1), (x2, y2) = place[name], place[other]
        x1 += width * (leaves[name].index((name, other)) + 1) / (len(leaves[name]) + 1)
        x2 += width * (enters[other].index((name, other)) + 1) / (len(enters[other]) + 1)
        out.append(
            f'<path d="M{x1:g} {y1 + height:g} C{x1:g} {y1 + height + rise:g} {x2:g} {y2 - rise:g} '
            f'{x2:g} {y2:g}" fill="none" stroke="#5b7" opacity="0.6"/>'
        )
    for name, (left, top) in sorted(place.items()):
        out.append(
            f'<rect x="{left:g}" y="{top:g}" width="{width}" height="{height}" rx="6" fill="#eef6f0" '
            'stroke="#275"/>'
            f'<text x="{left + width / 2:g}" y="{top + 22:g}" text-anchor="middle">{name}</text>'
        )
    return "\n".join([*out, "</svg>\n"])


def main() -> int:
    """Print the figures; draw where a file is named. Returns: 1 where packages are in a cycle."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("root", type=Path, nargs="?", default=Path())
    parser.add_argument("--svg", type=Path)
    arguments = parser.parse_args()
    graph = package_graph(arguments.root)
    flat = [name for name in graph if (arguments.root / "gcs" / f"{name}.py").is_file()]
    edges = sum(map(len, graph.values()))
    print(f"{len(graph) - len(flat)} packages, {len(flat)} modules flat in gcs, {edges} edges of imports")
    try:
        rows = levels(graph)
    except CycleError as error:
        print(f"cycle: {' -> '.join(error.args[1])}")
        return 1
    print(f"{len(rows)} levels, no cycle")
    if arguments.svg:
        arguments.svg.write_text(svg(graph), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
