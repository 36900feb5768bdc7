"""Reads a zip archive that is not trusted, in memory: size, entries and expansion are bounded."""

import io
import posixpath
import zipfile
import zlib
from typing import Final
from urllib.parse import unquote

from gcs.model.errors import DrawingError, quoted

ARCHIVE_MAX_BYTES: Final = 64 * 1024**2
ENTRIES_MAX: Final = 10_000
"""1,000 vehicles with some files each."""

ENTRY_MAX_BYTES: Final = 24 * 1024**2
TOTAL_MAX_BYTES: Final = 256 * 1024**2
"""Of everything that is read from one archive; an entry that is read twice counts twice."""

RATIO_MAX: Final = 200
"""Most that what is beyond `SMALL_BYTES` may expand; deflate reaches 1,032, numbers as text about 20."""

SMALL_BYTES: Final = 8 * 1024**2
_BOUNDED: Final = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}
"""Compressions that are undone piece by piece; of bzip2 and LZMA a few bytes expand to gigabytes at once."""

_ENTRY_SIGNATURE: Final = b"PK\x01\x02"
_BROKEN: Final = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    OSError,
    ValueError,
    NotImplementedError,
    RuntimeError,
)
"""Of zipfile: not a zip, corrupt, cut off; an unknown compression; encrypted (RuntimeError)."""


class Archive:
    """An archive in memory. Raises: DrawingError, on creation and from `read`, naming file and entry."""

    def __init__(self, data: bytes, file: str) -> None:
        """`file` names the archive in errors."""
        self.file = file
        self._read_bytes = 0
        self._most_bytes = min(TOTAL_MAX_BYTES, max(SMALL_BYTES, RATIO_MAX * len(data)))
        if len(data) > ARCHIVE_MAX_BYTES:
            raise DrawingError(file, f"{len(data)} bytes: at most {ARCHIVE_MAX_BYTES} are accepted")
        if data.count(_ENTRY_SIGNATURE) > ENTRIES_MAX:  # before zipfile makes an object for each
            raise DrawingError(file, f"more than {ENTRIES_MAX} entries")
        try:
            self._zip = zipfile.ZipFile(io.BytesIO(data))
        except _BROKEN as error:
            raise DrawingError(file, f"not a zip archive that can be read: {error}") from None
        self._infos: dict[str, zipfile.ZipInfo] = {}
        for info in self._zip.infolist():
            name = plain(info.filename)
            if info.filename.endswith(("/", "\\")):
                continue
            known = self._infos.get(name)
            if known is not None and known.filename != info.filename:
                raise DrawingError(file, f"two entries are called {quoted(name)}")
            self._infos[name] = info

    @property
    def names(self) -> list[str]:
        """Plain names of the entries, in the archive's order, without those that a file manager adds."""
        return [
            name
            for name in self._infos
            if "__MACOSX" not in name.split("/") and not _base(name).startswith(".")
        ]

    def with_suffix(self, suffix: str) -> list[str]:
        """Return the plain names that end so, in capitals or not."""
        return [name for name in self.names if name.lower().endswith(suffix)]

    def find(self, base: str) -> str:
        """Return the name of the entry that is called so in the uppermost folder that has one."""
        found = sorted((name.count("/"), name) for name in self.names if _base(name) == base)
        if not found:
            raise DrawingError(self.file, f"there is no entry {quoted(base)}")
        if len(found) > 1 and found[0][0] == found[1][0]:
            first, second = (quoted(name) for _, name in found[:2])
            raise DrawingError(self.file, f"{first} and {second}: one {base} is needed")
        return found[0][1]

    def read(self, name: str) -> bytes:
        """Return the content of an entry by its plain name."""
        place = f"{self.file}: {name}"
        info = self._infos.get(name)
        if info is None:
            raise DrawingError(self.file, f"there is no entry {quoted(name)}")
        if info.compress_type not in _BOUNDED:
            raise DrawingError(place, f"compression {info.compress_type}: deflate, or none, is read")
        if info.file_size > ENTRY_MAX_BYTES:
            raise DrawingError(place, f"{info.file_size} bytes: at most {ENTRY_MAX_BYTES} in one entry")
        if info.file_size > max(SMALL_BYTES, RATIO_MAX * info.compress_size):
            raise DrawingError(
                place, f"{info.compress_size} bytes expand to {info.file_size}: at most {RATIO_MAX} times"
            )
        self._read_bytes += info.file_size
        if self._read_bytes > self._most_bytes:
            raise DrawingError(place, f"with the entries before it more than {self._most_bytes} bytes")
        try:
            with self._zip.open(info) as entry:
                content = entry.read(info.file_size + 1)
        except _BROKEN as error:
            raise DrawingError(place, f"cannot be read: {error}") from None
        return content

    def resolve(self, base: str, reference: str) -> str:
        """Return the name of the entry that a reference in entry `base` means, for example ``./a.json#``.

        A name may have a # of its own, and be written as in a URL.
        """
        head, sign, fragment = reference.rpartition("#")
        inside = bool(sign and fragment.strip("/"))  # ``#/path``, or a name with a #
        for path in (reference,) if inside or not sign else (reference, head):
            for spelled in (path, unquote(path)):
                name = plain(posixpath.join(posixpath.dirname(base), spelled.replace("\\", "/")))
                if name in self._infos:
                    return name
        what = "only whole entries, without #/path" if inside else "there is no such entry"
        raise DrawingError(f"{self.file}: {base}", f"$ref {quoted(reference)}: {what}")


def plain(name: str) -> str:
    """Return an entry's name with / between folders, and without ./ before them."""
    return posixpath.normpath(name.replace("\\", "/")).lstrip("/")


def _base(name: str) -> str:
    return name.rsplit("/", 1)[-1]
