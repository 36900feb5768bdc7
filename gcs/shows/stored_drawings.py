"""The drawings beside the stored show files: which show names which, and what of them is kept.

Which drawing a show names is found in its text without parsing YAML, which takes too long beside a flight.
The check of a show parses it, and compares the drawing's bytes with the hash that the show names.
"""

import contextlib
import os
import re
import shutil
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import Final

from gcs.model.errors import RefusedError
from gcs.service import DRAWING_MAX_BYTES
from gcs.shows.drawn import DrawnShow
from gcs.shows.formats import parse_drawing
from gcs.shows.formats.archive import ARCHIVE_MAX_BYTES
from gcs.shows.formats.files import IMPORTED

ALL_MAX_BYTES: Final = 512 * 1024**2
"""Most bytes of all drawings in the folder."""

_TEXT_MAX_BYTES: Final = 64 * 1024
_ENTRY: Final = re.compile(rb"^drawing:.*(?:\n[ \t]+.*)*", re.MULTILINE)
_SOURCE: Final = re.compile(
    rb"\bsource:\s*[\"']?([A-Za-z0-9][A-Za-z0-9_.-]{0,80}\.(?:skyc|zip|csv))(?![A-Za-z0-9_.-])"
)


def source_of(text: bytes) -> str | None:
    """Return the name of the drawing's file in a show file's text; None: the show has no drawing."""
    entry = _ENTRY.search(text)
    source = None if entry is None else _SOURCE.search(entry[0])
    return None if source is None else source[1].decode()


def named_by(path: Path) -> str | None:
    """As `source_of`, of a show file, which need not exist. Raises: OSError."""
    with contextlib.suppress(FileNotFoundError), path.open("rb") as file:
        return source_of(file.read(_TEXT_MAX_BYTES))
    return None


def keep(folder: Path, source: str, given: Path) -> None:
    """Copy the file `given` into the folder as `source`: completely or not at all.

    Raises: RefusedError when the file is too large, or with it all drawings are; OSError.
    """
    size = given.stat().st_size
    if size > DRAWING_MAX_BYTES:
        raise RefusedError(f"the drawing has {size} bytes: at most {DRAWING_MAX_BYTES} are accepted")
    kept = sum(path.stat().st_size for path in _drawings(folder) if path.name != source)
    if kept + size > ALL_MAX_BYTES:
        raise RefusedError(
            f"the drawings have {kept} bytes, and this one {size}: at most {ALL_MAX_BYTES}; remove a show"
        )
    beside = folder / f"{source}.part"
    try:
        with given.open("rb") as read, beside.open("wb") as written:
            shutil.copyfileobj(read, written, 1 << 20)
            written.flush()
            os.fsync(written.fileno())
        beside.replace(folder / source)
    finally:
        beside.unlink(missing_ok=True)


def read(folder: Path, source: str, digest: str) -> DrawnShow:
    """Read a drawing whose bytes have that SHA-256.

    Raises: RefusedError when the folder has no such file, or another; ConfigError when it cannot be read.
    """
    try:
        with (folder / source).open("rb") as file:
            data = file.read(ARCHIVE_MAX_BYTES + 1)
    except FileNotFoundError:
        raise RefusedError(
            f"the drawing {source} is not in its folder of shows: upload it there as well"
        ) from None
    except OSError as error:
        raise RefusedError(f"the drawing {source} cannot be read: {error.strerror}") from None
    computed = sha256(data).hexdigest()
    if computed != digest:
        text = f"SHA-256 {computed[:12]}..., not {digest[:12]}..."
        raise RefusedError(f"the drawing {source} in its folder of shows is another: {text}")
    return parse_drawing(data, source)


def drop_unnamed(folder: Path, source: str | None) -> None:
    """Remove a drawing that no show of the folder names any more."""
    if source is None or any(named_by(path) == source for path in folder.glob("*.yaml")):
        return
    with contextlib.suppress(FileNotFoundError):
        (folder / source).unlink()


def _drawings(folder: Path) -> Iterator[Path]:
    return (path for path in folder.iterdir() if path.suffix in IMPORTED)
