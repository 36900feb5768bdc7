"""Reports identifiers that the glossary has retired, and names of tests that are too long.

`vocabulary.json` holds the table: `words` are retired as parts of identifiers, `names` as whole ones.
Names of test functions are judged by their length alone; of documents, only code spans are judged.
`python -m tests.vocabulary` prints each place and exits with 1.
"""

import ast
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

TABLE = json.loads(Path(__file__).with_name("vocabulary.json").read_text(encoding="utf-8"))
PART = re.compile(r"[A-Z]+(?![a-z])|[A-Z][a-z]*|[a-z]+")
WORD = re.compile(r"[A-Za-z_]\w*")
KEY = re.compile(r"[A-Za-z_][\w.-]*")
SPAN = re.compile(r"`([^`\n]+)`")
TEST_NAME_MAX = 60
NO_CODE = re.compile(r"//[^\n]*|/\*.*?\*/|(?<=[\"'`])[^\"'`\n]* [^\"'`\n]*(?=[\"'`])", re.DOTALL)
HISTORY = (
    "CHANGELOG.md",
    "docs/decisions/",
    "docs/explanation/decisions/",
    "tests/vocabulary",
    "tests/unit/test_vocabulary.py",
)


def retired(name: str) -> str | None:
    """What replaces `name`; None when it is not retired."""
    if name in TABLE["allowed"] or name.startswith("test_"):
        return None
    if name in TABLE["names"]:
        return str(TABLE["names"][name])
    parts = [part.lower() for part in PART.findall(name)]
    if not any(part in TABLE["words"] for part in parts):
        return None
    return "_".join(TABLE["words"].get(part, part) for part in parts)


def python_names(source: str) -> Iterator[tuple[int, str]]:
    """Identifiers, parameters, attributes and strings that are keys, each with its line."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.Name):
            yield node.lineno, node.id
        elif isinstance(node, ast.Attribute):
            yield node.lineno, node.attr
        elif isinstance(node, ast.arg | ast.keyword) and node.arg is not None:
            yield node.lineno, node.arg
        elif isinstance(node, ast.alias):
            yield from ((node.lineno, part) for part in (node.asname or node.name).split("."))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and KEY.fullmatch(node.value):
            yield from ((node.lineno, part) for part in WORD.findall(node.value))


def other_names(path: str, source: str) -> Iterator[tuple[int, str]]:
    """Identifiers of TypeScript and styles without comments and sentences; code spans of documents."""
    if path.endswith(".md"):
        text = "\n".join(" ".join(SPAN.findall(line)) for line in source.split("\n"))
    else:
        text = NO_CODE.sub(lambda found: "\n" * found[0].count("\n"), source)
    for number, line in enumerate(text.split("\n"), start=1):
        yield from ((number, name) for name in WORD.findall(line))


def long_test_names(path: str, source: str) -> list[str]:
    """One line for each test function of a Python file whose name exceeds `TEST_NAME_MAX` characters."""
    if not path.endswith(".py"):
        return []
    return [
        f"{path}:{node.lineno}: {node.name} has {length} characters, at most {TEST_NAME_MAX} are allowed: "
        "put the sentence into the docstring"
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and node.name.startswith("test_")
        and (length := len(node.name)) > TEST_NAME_MAX
    ]


def findings(path: str, source: str) -> list[str]:
    """One line for each retired identifier and each long test name of a file."""
    names = python_names(source) if path.endswith(".py") else other_names(path, source)
    old = [
        f"{path}:{line}: {name} is retired: say {new}"
        for line, name in sorted(set(names))
        if (new := retired(name)) is not None
    ]
    return old + long_test_names(path, source)


def main() -> int:
    """Judge all tracked files."""
    tracked = subprocess.run(["git", "ls-files"], check=True, capture_output=True, text=True).stdout.split()  # noqa: S607 - git of the developer
    found = [
        line
        for path in tracked
        if path.endswith((".py", ".ts", ".css", ".md"))
        and not path.startswith(HISTORY)
        and Path(path).is_file()
        for line in findings(path, Path(path).read_text(encoding="utf-8"))
    ]
    print("\n".join(found) if found else "no retired name, no long test name")  # noqa: T201 - its output
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
