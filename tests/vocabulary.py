"""Reports identifiers and words that the glossary has retired, and names of tests that are too long.

`vocabulary.json` holds the table: `words` are retired as parts of identifiers, `names` as whole ones, `prose`
as words of every text. No variable of a function in gcs is called by one of `pronouns`, but `one` beside
`other`. Names of test functions are judged by `prose` and their length alone. Of documents, `words` and
`names` judge only code spans.
`python -m tests.vocabulary` prints each place and exits with 1.
"""

import ast
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

TABLE = json.loads(Path(__file__).with_name("vocabulary.json").read_text(encoding="utf-8"))
PART = re.compile(r"[A-Z]+(?![a-z])|[A-Z][a-z]*|[a-z]+")
WORD = re.compile(r"[A-Za-z_]\w*")
KEY = re.compile(r"[A-Za-z_][\w.-]*")
SPAN = re.compile(r"`([^`\n]+)`")
TEST_NAME_MAX = 60
LONG_TEST_NAME = re.compile(rf"\bdef (test_\w{{{TEST_NAME_MAX - 4},}})")
NO_CODE = re.compile(r"//[^\n]*|/\*.*?\*/|(?<=[\"'`])[^\"'`\n]* [^\"'`\n]*(?=[\"'`])", re.DOTALL)
JUDGED = (".py", ".ts", ".css", ".md")
NOT_RENAMED = ("gcs/cli/", "gcs/preflight/", "gcs/shows/formats/", "gcs/testing/")
"""Packages whose variables still may be called by pronouns."""

HISTORY = (
    "CHANGELOG.md",
    "docs/decisions/history/",
    "tests/vocabulary",
    "tests/unit/test_vocabulary.py",
)


@cache
def replaced(name: str, table: str) -> str | None:
    """`name` with its parts replaced that the table `words` or `prose` has; None without such parts."""
    parts = [part.lower() for part in PART.findall(name)]
    if TABLE[table].keys().isdisjoint(parts):
        return None
    return "_".join(TABLE[table].get(part, part) for part in parts)


@cache
def retired(name: str) -> str | None:
    """What replaces the identifier `name`; None when it is not retired."""
    if name in TABLE["allowed"] or name.startswith("test_"):
        return None
    return str(TABLE["names"][name]) if name in TABLE["names"] else replaced(name, "words")


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


def pronouns(source: str) -> Iterator[tuple[int, str]]:
    """Variables and parameters of functions that say nothing, each with its line."""
    tree = ast.parse(source)
    used = {getattr(node, "id", getattr(node, "arg", None)) for node in ast.walk(tree)}
    if used.isdisjoint(TABLE["pronouns"]):  # in most files; below a function is walked twice
        return
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        lines: dict[str, int] = {}
        for node in ast.walk(function):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                lines.setdefault(node.id, node.lineno)
            elif isinstance(node, ast.arg):
                lines.setdefault(node.arg, node.lineno)
        for name in lines.keys() & TABLE["pronouns"].keys():
            if name != "one" or "other" not in lines:
                yield lines[name], name


def words_of(text: str) -> Iterator[tuple[int, str]]:
    """Every word of a text with its line."""
    for number, line in enumerate(text.split("\n"), start=1):
        yield from ((number, word) for word in WORD.findall(line))


def other_names(path: str, source: str) -> Iterator[tuple[int, str]]:
    """Identifiers of TypeScript and styles without comments and sentences; code spans of documents."""
    if path.endswith(".md"):
        return words_of("\n".join(" ".join(SPAN.findall(line)) for line in source.split("\n")))
    return words_of(NO_CODE.sub(lambda found: "\n" * found[0].count("\n"), source))


def findings(path: str, source: str) -> list[str]:
    """One line for each retired identifier, retired word and long test name of a file."""
    words = set(WORD.findall(source))
    found: list[tuple[int, str, str | None]] = []
    if any(map(retired, words)):  # only then is it worth parsing
        names = python_names(source) if path.endswith(".py") else other_names(path, source)
        found += [(line, name, retired(name)) for line, name in names]
    if any(replaced(word, "prose") for word in words):
        found += [(line, word, replaced(word, "prose")) for line, word in words_of(source)]
    old = [
        f"{path}:{line}: {name} is retired: say {new}"
        for line, name, new in sorted({each for each in found if each[2] is not None})
    ]
    if not path.endswith(".py"):
        return old
    if path.startswith("gcs/") and not path.startswith(NOT_RENAMED):
        old += [
            f"{path}:{line}: {name} says nothing: say {TABLE['pronouns'][name]}"
            for line, name in sorted(set(pronouns(source)))
        ]
    return old + [
        f"{path}:{source.count(chr(10), 0, name.start()) + 1}: {name[1]} has {len(name[1])} characters, "
        f"at most {TEST_NAME_MAX} are allowed: put the sentence into the docstring"
        for name in LONG_TEST_NAME.finditer(source)
    ]


def main() -> int:
    """Judge all tracked files."""
    tracked = subprocess.run(["git", "ls-files"], check=True, capture_output=True, text=True).stdout.split()  # noqa: S607 - git of the developer
    found = [
        line
        for path in tracked
        if path.endswith(JUDGED) and not path.startswith(HISTORY) and Path(path).is_file()
        for line in findings(path, Path(path).read_text(encoding="utf-8"))
    ]
    print("\n".join(found) if found else "no retired name, no long test name")  # noqa: T201 - its output
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
