"""Reads XML that is not trusted: no document type, no entity, bounded depth and number of elements. Pure.

Expat reads it, as `gcs.links.targets.cot` does: it resolves nothing outside, and without a document type
there is no entity to expand.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, NoReturn
from xml.parsers import expat

from gcs.model.errors import SiteError, cut

DEPTH_MAX: Final = 32
ELEMENTS_MAX: Final = 20_000


@dataclass(slots=True)
class Element:
    """An element without the prefix of its namespace."""

    name: str
    line: int
    attributes: dict[str, str] = field(default_factory=dict)
    inside: list["Element"] = field(default_factory=list)
    text: str = ""

    def children(self, name: str) -> Iterator["Element"]:
        return (element for element in self.inside if element.name == name)

    def child(self, *path: str) -> "Element | None":
        """The first element on a path; None: there is none."""
        element: Element | None = self
        for name in path:
            element = None if element is None else next(element.children(name), None)
        return element

    def text_of(self, *path: str) -> str:
        """The text of the first element on a path, without spaces around it; empty: there is none."""
        element = self.child(*path)
        return "" if element is None else element.text.strip()

    def everywhere(self, name: str) -> Iterator["Element"]:
        """Yield the elements of this name, in order; those inside such elements as well."""
        for element in self.inside:
            if element.name == name:
                yield element
            yield from element.everywhere(name)


class _Tree:
    def __init__(self, file: str) -> None:
        self._file, self._elements = file, 0
        self.root = Element("", 1)
        self._path = [self.root]
        self.parser = parser = expat.ParserCreate()
        parser.buffer_text = True
        parser.StartElementHandler, parser.EndElementHandler = self._begin, self._end
        parser.CharacterDataHandler = self._characters
        parser.StartDoctypeDeclHandler = self._document_type

    def refused(self, problem: str) -> SiteError:
        return SiteError(f"{self._file}: line {self.parser.CurrentLineNumber}", problem)

    def _document_type(self, *_: object) -> NoReturn:
        raise self.refused("a document type (<!DOCTYPE) is not read: leave it out")

    def _begin(self, name: str, attributes: dict[str, str]) -> None:
        self._elements += 1
        if self._elements > ELEMENTS_MAX or len(self._path) > DEPTH_MAX:
            raise self.refused(f"more than {ELEMENTS_MAX} elements, or {DEPTH_MAX} levels")
        element = Element(name.rpartition(":")[2], self.parser.CurrentLineNumber, attributes)
        self._path[-1].inside.append(element)
        self._path.append(element)

    def _end(self, _: str) -> None:
        self._path.pop()

    def _characters(self, text: str) -> None:
        self._path[-1].text += text


def parsed_xml(data: bytes, file: str) -> Element:
    """The document, as the only element inside the one that is returned. Raises: SiteError with the line."""
    tree = _Tree(file)
    try:
        tree.parser.Parse(data, True)
    except expat.ExpatError as error:
        raise SiteError(
            f"{file}: line {error.lineno}", f"not XML: {cut(expat.ErrorString(error.code))}"
        ) from None
    except (LookupError, ValueError) as error:  # an unknown encoding
        raise SiteError(file, f"not XML in UTF-8: {cut(str(error))}") from None
    return tree.root
