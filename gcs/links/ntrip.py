"""Asks an NTRIP caster for a mount point, and takes the bytes of it out of the answer.

The request is that of the first revision, a GET of HTTP/1.0, which every caster understands. Answers may be
of either revision: ICY, HTTP/1.0, or HTTP/1.1 with chunked transfer coding.
"""

import asyncio
from base64 import b64encode
from dataclasses import dataclass
from typing import ClassVar, Final

from gcs.links.byte_sources import Plain
from gcs.model.errors import LinkError, quoted

_HEADERS_MAX: Final = 64
_CHUNK_LINE_MAX: Final = 256
_TEXT_MAX: Final = 80
_NO_DATA: Final = ("text/", "application/json", "application/xhtml")
"""Content types that are no data."""


async def ask_caster(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, path: str, login: str
) -> "Plain | Chunked":
    """Ask for a mount point as `login`, USER:PASSWORD or empty. Returns: what takes the data out of the rest.

    Raises: LinkError with why there are none.
    """
    lines = [f"GET {path} HTTP/1.0", "User-Agent: NTRIP formation-gcs", "Accept: */*"]
    if login:
        lines.append(f"Authorization: Basic {b64encode(login.encode()).decode()}")
    writer.write("\r\n".join([*lines, "", ""]).encode())
    answer = await _line(reader)
    if answer.startswith("SOURCETABLE"):
        raise LinkError(f"the caster has no mount point {path}")
    if answer.startswith("ICY 200"):  # the data begins at once, or after lines that are none
        return Plain()
    status = answer.partition(" ")[2].split(" ")[0]
    headers = await _headers(reader) if answer.startswith("HTTP/") else {}
    if status != "200":
        to = headers.get("location", "")
        elsewhere = f" and sends to {_shown(to)}: the network may need a login" if to else ""
        raise LinkError(f"the caster answers {_shown(answer)} for {path}{elsewhere}")
    kind = headers.get("content-type", "").lower()
    if kind.startswith("gnss/sourcetable"):
        raise LinkError(f"the caster has no mount point {path}")
    if kind.startswith(_NO_DATA):
        raise LinkError(
            f"the answer for {path} is {_shown(kind)}, no data: no caster, or the network needs a login"
        )
    coding = headers.get("transfer-encoding", "identity").lower()
    if coding not in {"identity", "chunked"}:
        raise LinkError(f"the caster sends with transfer coding {_shown(coding)}, not chunked")
    return Plain() if coding == "identity" else Chunked()


@dataclass(slots=True)
class Chunked:
    """Takes the data out of chunks. Source: RFC 9112, 7.1.

    Attributes:
        ended: the last chunk has arrived.
        turn_bytes: most to read in a turn; flow control holds back the sender of more.
    """

    turn_bytes: ClassVar = 8192  # chunks of one byte are work

    ended: bool = False
    _left: int = 0  # bytes of the chunk that have not arrived yet
    _line: bytes = b""  # what has arrived of the line before a chunk
    _begun: bool = False  # a chunk has ended, and its line end is to come

    def take(self, data: bytes) -> bytes:
        """The data in these bytes. Raises: LinkError when they are no chunks."""
        parts, at = [], 0
        while at < len(data) and not self.ended:
            if self._left:
                parts.append(data[at : at + self._left])
                at += len(parts[-1])
                self._left -= len(parts[-1])
                continue
            end = data.find(b"\n", at, at + _CHUNK_LINE_MAX)
            piece = data[at : end if end >= 0 else at + _CHUNK_LINE_MAX]
            at += len(piece) + (end >= 0)
            self._line += piece
            if len(self._line) >= _CHUNK_LINE_MAX:
                raise LinkError("the caster's chunks cannot be read: a line that is too long")
            if end >= 0:
                self._size(self._line.strip())
                self._line = b""
        return b"".join(parts)

    def _size(self, line: bytes) -> None:
        if not line and self._begun:
            self._begun = False
            return
        digits = line.partition(b";")[0].strip()
        if not digits or len(digits) > 8 or digits.strip(b"0123456789abcdefABCDEF"):
            raise LinkError(f"the caster's chunks cannot be read: size {_shown(line.decode('latin-1'))}")
        self._left, self._begun = int(digits, 16), True
        self.ended = not self._left


async def _headers(reader: asyncio.StreamReader) -> dict[str, str]:
    headers: dict[str, str] = {}
    for _ in range(_HEADERS_MAX):
        line = await _line(reader)
        if not line:
            return headers
        name, _, value = line.partition(":")
        headers[name.strip().lower()] = value.strip()
    raise LinkError("the caster's answer has no end")


async def _line(reader: asyncio.StreamReader) -> str:
    try:
        return (await reader.readuntil(b"\n")).decode("latin-1").strip()
    except asyncio.LimitOverrunError as error:
        raise LinkError("the caster answers with a line that is too long") from error
    except asyncio.IncompleteReadError as error:
        raise LinkError(f"the caster ends after {_shown(error.partial.decode('latin-1'))}") from error


def _shown(text: str) -> str:
    return quoted(text[:_TEXT_MAX])
