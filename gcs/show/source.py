"""The text of a show file, and which line says what."""

from collections.abc import Iterator, Sequence
from typing import TypeAlias

import yaml
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from gcs.errors import Problem, ShowError

Loc: TypeAlias = Sequence[str | int]
"""The way to a value, as pydantic tells it: keys and indices."""


class Source:
    """A show file's text; line numbers count from 1."""

    def __init__(self, text: str, file: str) -> None:
        """`file` names it in errors. Raises: ShowError when `text` is not YAML, or a key is there twice."""
        try:
            self._root = yaml.compose(text, Loader=yaml.SafeLoader)
        except yaml.MarkedYAMLError as error:
            line = 1 if error.problem_mark is None else error.problem_mark.line + 1
            raise ShowError(file, [Problem(line, None, f"not YAML: {error.problem}")]) from None
        except (yaml.YAMLError, RecursionError) as error:
            raise ShowError(file, [Problem(1, None, f"not YAML: {error}")]) from None
        twice = [Problem(line, None, f"key '{key}' is there twice") for key, line in _repeated(self._root)]
        if twice:
            raise ShowError(file, twice)

    def line(self, *loc: str | int) -> int:
        """The line of the key, or the entry of a list, that `loc` leads to.

        As far as it leads: what is missing is missing from what is there. Parts that are no keys (pydantic
        names the alternatives it tried) are passed over.
        """
        node, line = self._root, 1
        for part in loc:
            found = _within(node, part)
            if found is not None:
                node, line = found
        return line


def _within(node: Node | None, part: str | int) -> tuple[Node, int] | None:
    """The value under a key or index of `node`, and its line; None: there is none."""
    if isinstance(node, MappingNode):
        for key, value in node.value:
            if isinstance(key, ScalarNode) and key.value == str(part):
                return value, key.start_mark.line + 1
    if isinstance(node, SequenceNode) and isinstance(part, int) and part < len(node.value):
        entry = node.value[part]
        return entry, entry.start_mark.line + 1
    return None


def _repeated(root: Node | None) -> Iterator[tuple[str, int]]:
    """Keys that are there twice in one mapping, and their lines."""
    waiting, seen = [root], set[int]()
    while waiting:
        node = waiting.pop()
        if node is None or id(node) in seen:
            continue  # an alias
        seen.add(id(node))
        if isinstance(node, SequenceNode):
            waiting += node.value
        if isinstance(node, MappingNode):
            keys = [key for key, _ in node.value if isinstance(key, ScalarNode)]
            for at, key in enumerate(keys):
                if key.value in {other.value for other in keys[:at]}:
                    yield key.value, key.start_mark.line + 1
            waiting += [value for _, value in node.value]
