"""Reads and writes the file of a drawn show; its suffix says in which format."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

from gcs.model.errors import ConfigError, DrawingError
from gcs.shows.drawn import DrawnShow
from gcs.shows.formats.archive import ARCHIVE_MAX_BYTES, Archive
from gcs.shows.formats.csv_show import read_csv_zip, write_csv_zip
from gcs.shows.formats.polynomials import read_polynomials
from gcs.shows.formats.skybrush import SHOW, read_skyc
from gcs.shows.formats.skybrush_writer import write_skyc
from gcs.shows.formats.vviz import write_vviz


def _read_archive(data: bytes, file: str) -> DrawnShow:
    """Read an archive as what it holds; the name counts where it holds neither. Raises: DrawingError."""
    archive = Archive(data, file)
    tables = file.lower().endswith(".zip") or archive.with_suffix(".csv")
    return read_csv_zip(archive) if tables and not archive.with_suffix(SHOW) else read_skyc(archive)


IMPORTED: Final[dict[str, Callable[[bytes, str], DrawnShow]]] = {
    ".skyc": _read_archive,
    ".zip": _read_archive,
    ".csv": read_polynomials,
}
EXPORTED: Final[dict[str, Callable[[DrawnShow], bytes]]] = {
    ".skyc": write_skyc,
    ".vviz": write_vviz,
    ".zip": write_csv_zip,
}


def read_drawing(path: Path) -> tuple[DrawnShow, bytes]:
    """Return the drawn show in a file, and the file's bytes.

    Raises: DrawingError, with the place of what is wrong; ConfigError when the file cannot be read.
    """
    try:
        with path.open("rb") as file:
            data = file.read(ARCHIVE_MAX_BYTES + 1)
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from None
    return parse_drawing(data, path.name), data


def parse_drawing(data: bytes, file: str) -> DrawnShow:
    """Return the drawn show in the bytes of a file of that name. Raises: DrawingError."""
    suffix = Path(file).suffix.lower()
    if suffix not in IMPORTED:
        raise DrawingError(file, f"files with {', '.join(IMPORTED)} are imported")
    if len(data) > ARCHIVE_MAX_BYTES:
        raise DrawingError(file, f"more than {ARCHIVE_MAX_BYTES} bytes")
    if not data:
        raise DrawingError(file, "the file is empty")
    if suffix == ".csv" and data.startswith(b"PK"):
        raise DrawingError(file, "a zip archive: give it the suffix .skyc or .zip")
    return IMPORTED[suffix](data, file)


def write_drawing(show: DrawnShow, path: Path) -> None:
    """Write a drawn show to a file. Raises: ConfigError for another suffix, or when it cannot be written."""
    suffix = path.suffix.lower()
    if suffix not in EXPORTED:
        raise ConfigError(f"{path}: a drawn show is exported to {', '.join(EXPORTED)}")
    content = EXPORTED[suffix](show)
    try:
        path.write_bytes(content)
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from None
