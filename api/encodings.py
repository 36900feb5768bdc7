"""Content negotiation of files: compressed beforehand, or as they are (RFC 9110, 12.5.3 and 13.1.2)."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

TWINS: Final[Mapping[str, str]] = {"br": ".br", "gzip": ".gz"}
"""Suffix of the compressed file beside the file, by content coding; the better compressed first."""

IDENTITY: Final = "identity"


class Form(NamedTuple):
    """A file in one content coding."""

    path: Path
    coding: str  # a key of TWINS, or IDENTITY

    @property
    def headers(self) -> dict[str, str]:
        """Headers of this form: its ETag and coding. Raises: OSError when the file is gone."""
        stat = self.path.stat()
        reported = {
            "Vary": "Accept-Encoding",
            "ETag": f'"{stat.st_mtime_ns:x}-{stat.st_size:x}-{self.coding}"',
        }
        return reported if self.coding == IDENTITY else {**reported, "Content-Encoding": self.coding}


def is_twin(name: str) -> bool:
    """Whether a name belongs to the compressed form of another file."""
    return name.endswith(tuple(TWINS.values()))


def chosen(file: Path, accept_encoding: str | None) -> Form | None:
    """Return the form of `file` that the caller prefers, the smallest of equals; None: it accepts none."""
    liked = qualities(accept_encoding)
    best: tuple[float, Form] | None = None
    for coding, ending in (*TWINS.items(), (IDENTITY, "")):
        path = file.with_name(file.name + ending)
        quality = _quality(coding, liked)
        if quality > 0.0 and (best is None or quality > best[0]) and path.is_file():
            best = quality, Form(path, coding)
    return None if best is None else best[1]


def qualities(accept_encoding: str | None) -> dict[str, float]:
    """Parse the header (None: absent) into qualities by content coding; invalid entries count as refused."""
    found: dict[str, float] = {}
    for part in (accept_encoding or "").split(","):
        coding, _, parameter = part.partition(";")
        if coding.strip():
            found[coding.strip().lower()] = _number(parameter)
    return found


def _number(parameter: str) -> float:
    name, given, value = parameter.strip().partition("=")
    if not given:
        return 1.0
    try:
        quality = float(value)
    except ValueError:
        return 0.0
    return quality if name.strip().lower() == "q" and 0.0 <= quality <= 1.0 else 0.0


def _quality(coding: str, liked: Mapping[str, float]) -> float:
    """Uncompressed files are sent unless refused, compressed ones only on request."""
    if coding in liked:
        return liked[coding]
    if coding == IDENTITY:
        return 1e-4 if liked.get("*", 1.0) > 0.0 else 0.0  # any coding that is named is preferred
    return liked.get("*", 0.0)


def is_known(etag: str, if_none_match: str | None) -> bool:
    """Whether `If-None-Match` contains this form's ETag."""
    known = {part.strip().removeprefix("W/") for part in (if_none_match or "").split(",")}
    return etag in known or "*" in known
