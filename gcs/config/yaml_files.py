"""Reads a YAML file: its values, and the line and column of each.

Any operator can upload a show, so input is bounded: no anchors, aliases and merge keys (a few hundred bytes
of them expand to gigabytes), no tags, and limited numbers of values and levels. Plain words are numbers and
booleans as in YAML 1.2: `yes` and `12:30` are text, `1e3` is a number.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from importlib import resources
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

import yaml
from yaml.events import AliasEvent, Event, NodeEvent
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from gcs.model.errors import UNSEEN, ConfigError, FileError, Problem, cut

Loc: TypeAlias = Sequence[str | int]
"""Path to a value, as in pydantic: keys and indices."""

CHARACTERS_MAX: Final = 1_000_000
"""Most characters of a file; a long file has some tens of thousands."""

VALUES_MAX: Final = 100_000
DEPTH_MAX: Final = 32

Mark: TypeAlias = yaml.error.Mark | Any  # or the C library's mark, which has the same attributes

_STANDARD: Final = "tag:yaml.org,2002:"
_TEXT, _NULL, _TRUTH, _WHOLE, _NUMBER = (
    f"{_STANDARD}{kind}" for kind in ("str", "null", "bool", "int", "float")
)
_PLAIN: Final = {
    _NULL: r"~|null|Null|NULL|",
    _TRUTH: r"true|True|TRUE|false|False|FALSE",
    _WHOLE: r"[-+]?[0-9]{1,40}|0o[0-7]{1,40}|0x[0-9a-fA-F]{1,40}",
    _NUMBER: r"[-+]?(?:\.[0-9]{1,40}|[0-9]{1,40}(?:\.[0-9]{0,40})?)(?:[eE][-+]?[0-9]{1,5})?"
    r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)",
}
"""Meaning of plain words: the core schema of YAML 1.2."""


class _Loader(yaml.SafeLoader):
    """Composes trees of bounded size, without anchors, aliases and tags."""

    yaml_implicit_resolvers: Any = {}  # noqa: RUF012  (as in PyYAML; filled once, below)

    def __init__(self, text: str, file: str) -> None:
        super().__init__(text)
        self._file = file
        self._values = 0
        self._depth = 0
        self.twice: list[tuple[str, Mark]] = []  # repeated keys of a mapping

    def _refused(self, at: Event | Node, text: str) -> FileError:
        return FileError(self._file, [_problem(at.start_mark, text)])

    def compose_node(self, parent: Node | None, index: Any) -> Node | None:
        """As in SafeLoader, within bounds."""
        event: Event = self.peek_event()  # type: ignore[no-untyped-call]
        if isinstance(event, AliasEvent):
            text = f"*{cut(str(event.anchor))}: aliases are not allowed: write the value out"
            raise self._refused(event, text)
        if isinstance(event, NodeEvent) and event.anchor is not None:
            text = f"&{cut(event.anchor)}: anchors are not allowed: write the value out where it is needed"
            raise self._refused(event, text)
        tag = getattr(event, "tag", None)
        if tag is not None:
            named = cut(str(tag).replace(_STANDARD, "!!"))
            raise self._refused(event, f"{named}: tags are not allowed: leave it out")
        self._values += 1
        self._depth += 1
        if self._values > VALUES_MAX:
            raise self._refused(event, f"more than {VALUES_MAX} values")
        if self._depth > DEPTH_MAX:
            raise self._refused(event, f"nested deeper than {DEPTH_MAX} levels")
        node: Node | None = super().compose_node(parent, index)
        if isinstance(node, ScalarNode) and (unseen := UNSEEN.search(node.value)):
            raise self._refused(node, f"character U+{ord(unseen[0]):04X} is not allowed")
        self._depth -= 1
        return node

    def compose_mapping_node(self, anchor: Any) -> MappingNode:
        """As in SafeLoader, with text keys, each once."""
        node: MappingNode = super().compose_mapping_node(anchor)
        seen: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, ScalarNode):
                raise self._refused(key, "a key must be a word, not a list or a section")
            if key.value == "<<" and key.style is None:
                raise self._refused(key, "<<: merge keys are not allowed: write the keys out")
            if key.value in seen:
                self.twice.append((key.value, key.start_mark))
            seen.add(key.value)
        return node


for _tag, _pattern in _PLAIN.items():
    _Loader.add_implicit_resolver(_tag, re.compile(rf"^(?:{_pattern})\Z"), None)


def _whole(text: str) -> int:
    return int(text, 0) if text[:2] in {"0o", "0x"} else int(text)


def _number(text: str) -> float:
    return float(text.replace(".inf", "inf").replace(".nan", "nan")) if text[-1] in "fFnN" else float(text)


_MEANING: Final[dict[str, Callable[[str], object]]] = {
    _NULL: lambda _: None,
    _TRUTH: lambda text: text.lower() == "true",
    _WHOLE: _whole,
    _NUMBER: lambda text: _number(text.lower()),
}


class Source:
    """A YAML file: its values and their locations; lines and columns count from 1."""

    def __init__(self, text: str, file: str) -> None:
        """`file` names it in errors. Raises: FileError when `text` is not accepted YAML."""
        self.file = file
        if len(text) > CHARACTERS_MAX:
            raise FileError(file, [Problem(1, None, f"{len(text)} characters: at most {CHARACTERS_MAX}")])
        try:
            loader = _Loader(text, file)
            self._root: Node | None = loader.get_single_node()
        except yaml.MarkedYAMLError as error:
            words = f"not YAML: {cut(error.problem or error.context or 'it cannot be read')}"
            raise FileError(file, [_problem(error.problem_mark or error.context_mark, words)]) from None
        except (ValueError, OverflowError):  # of an escape, "\U00110000" for instance
            line = loader.line + 1
            raise FileError(file, [Problem(line, None, "not YAML: an escape beyond Unicode")]) from None
        except yaml.reader.ReaderError as error:
            line = text.count("\n", 0, error.position) + 1
            words = f"not YAML: character U+{ord(text[error.position]):04X} is not allowed"
            raise FileError(file, [Problem(line, None, words)]) from None
        if loader.twice:
            twice = [(mark.line + 1, f"key '{cut(key)}' is there twice") for key, mark in loader.twice]
            raise FileError(file, [Problem(line, None, words) for line, words in twice])

    def value(self) -> object:
        """Return the file's content as dicts, lists, strings, numbers, booleans and None."""
        return None if self._root is None else _plain_value(self._root)

    def mapping(self, needed: str) -> dict[str, object]:
        """Return the content as a dict. Raises: FileError, with `needed`, when it is not a mapping."""
        content = self.value()
        if not isinstance(content, dict):
            raise FileError(self.file, [Problem(1, None, f"a mapping is needed, with {needed}")])
        return content

    def line(self, *loc: str | int) -> int:
        """Return the line of the key or list entry at `loc`.

        For a missing value it is the line of its innermost existing parent. Parts that are not keys (pydantic
        names the alternatives that it tried) are skipped.
        """
        return self._follow(loc)[1]

    def keys(self, *loc: str | int) -> tuple[str | int, ...]:
        """Return the parts of `loc` that are in the file."""
        return self._follow(loc)[2]

    def written(self, *loc: str | int) -> str | None:
        """Return the value as written, shortened; None for a list, a section or a missing value."""
        node, _, keys = self._follow(loc)
        if not isinstance(node, ScalarNode) or not keys:
            return None
        if node.tag == _TEXT:
            return f"'{cut(node.value)}'"
        return cut(node.value) or "nothing"

    def changed(self, text: str, changes: Mapping[Sequence[str], str]) -> str:
        """Return the text with other values; comments and all else stay as written.

        Args:
            text: of this file.
            changes: YAML on one line for each path; a missing last key is added to its mapping.

        Raises: KeyError when the mapping of a path is missing or empty.
        """
        edits: list[tuple[int, int, str]] = []
        for loc, value in changes.items():
            mapping, _, keys = self._follow(loc[:-1])
            if not isinstance(mapping, MappingNode) or len(keys) < len(loc) - 1 or not mapping.value:
                raise KeyError(".".join(loc))
            at = _within(mapping, loc[-1])
            if at is not None:
                edits.append((at[0].start_mark.index, _end(at[0]), value))
                continue
            first = mapping.value[0][0].start_mark
            after = ", " if mapping.flow_style else "\n" + " " * first.column
            edits.append((first.index, first.index, f"{loc[-1]}: {value}{after}"))
        for start, end, value in sorted(edits, reverse=True):
            text = text[:start] + value + text[end:]
        return text

    def _follow(self, loc: Loc) -> tuple[Node | None, int, tuple[str | int, ...]]:
        node, line, keys = self._root, 1, list[str | int]()
        for part in loc:
            inner = _within(node, part)
            if inner is not None:
                node, line = inner
                keys.append(part)
        return node, line, tuple(keys)


def _problem(mark: Mark | None, text: str) -> Problem:
    if mark is None:
        return Problem(1, None, text)
    return Problem(mark.line + 1, None, f"column {mark.column + 1}: {text}")


def _plain_value(node: Node) -> object:
    """Convert a node, recursively: its depth is bounded."""
    if isinstance(node, MappingNode):
        return {key.value: _plain_value(value) for key, value in node.value}
    if isinstance(node, SequenceNode):
        return [_plain_value(entry) for entry in node.value]
    meaning = _MEANING.get(node.tag)
    return str(node.value) if meaning is None else meaning(node.value)


def _within(node: Node | None, part: str | int) -> tuple[Node, int] | None:
    """Return the value under a key or index of `node`, and its line; None: there is none."""
    if isinstance(node, MappingNode):
        for key, value in node.value:
            if isinstance(key, ScalarNode) and key.value == str(part):
                return value, key.start_mark.line + 1
    if isinstance(node, SequenceNode) and isinstance(part, int) and part < len(node.value):
        entry = node.value[part]
        return entry, entry.start_mark.line + 1
    return None


def _end(node: Node) -> int:
    """Return the offset behind a value's last character: the mark of a block is at the next token."""
    if not isinstance(node, MappingNode | SequenceNode) or node.flow_style or not node.value:
        return int(node.end_mark.index)
    last = node.value[-1]
    return _end(last[1] if isinstance(node, MappingNode) else last)


class Kind(NamedTuple):
    """A kind of file, with its folder."""

    plural: str  # its name in messages
    folder: str  # inside `configs`; "" is `configs` itself

    def shipped(self) -> list[Path]:
        return sorted((shipped_folder() / self.folder).glob("*.yaml"))

    def find(self, name: str) -> Path:
        """Find a file by path, else a shipped one by name. Raises: ConfigError that names the shipped ones.

        Works from a checkout and from an installed wheel.
        """
        path = Path(name)
        if path.is_file():
            return path
        inside = shipped_folder() / self.folder / f"{path.name.removesuffix('.yaml')}.yaml"
        if path.parent in {Path(), Path("configs") / self.folder} and inside.is_file():
            return inside
        if path.is_dir():
            inside_it = next((file.name for file in sorted(path.glob("*.yaml"))), "FILE.yaml")
            raise ConfigError(f"{name}: it is a folder: name the file in it, such as {path / inside_it}")
        names = [file.stem for file in self.shipped()]
        near = get_close_matches(path.stem, names, 3)
        similar = f"; near it: {', '.join(near)}" if near else ""
        shipped = f"{self.plural} that come with the package: {', '.join(names)}"
        raise ConfigError(f"{name}: there is no such file{similar}; {shipped}")


CONFIGURATIONS = Kind("configurations", "")
SHOWS = Kind("shows", "shows")
SCENARIOS = Kind("scenarios", "scenarios")


def shipped_folder() -> Path:
    """Folder of the configurations: inside an installed wheel, or beside `gcs` in a checkout."""
    package = Path(str(resources.files("gcs")))
    packed = package / "_configs"
    return packed if packed.is_dir() else package.parent / "configs"


def read(path: Path) -> str:
    """Read the text of a file. Raises: ConfigError when it cannot be read."""
    try:
        with path.open("rb") as file:
            data = file.read(4 * CHARACTERS_MAX + 1)
    except IsADirectoryError:
        raise ConfigError(f"{path}: cannot be read: it is a folder: name the file in it") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from None
    if len(data) > 4 * CHARACTERS_MAX:
        raise ConfigError(f"{path}: cannot be read: larger than {4 * CHARACTERS_MAX} bytes")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        where = f"line {line}: byte {error.start} (0x{data[error.start]:02x})"
        raise ConfigError(f"{path}: cannot be read: {where} is not UTF-8: save the file as UTF-8") from None
