"""Shows that arrive from other stations over the bus; their drawings come from this station's folder."""

import json
import logging
import zlib
from base64 import b64decode, b64encode
from binascii import Error as Base64Error
from collections.abc import Sequence
from concurrent.futures import Executor, Future
from dataclasses import replace
from typing import Final

from pydantic import TypeAdapter

from gcs.flight.running_show import ShowRun
from gcs.flight.site_requests import PART_MAX, PARTS_MAX, ShowPart
from gcs.model.errors import ConfigError, GcsError, RefusedError
from gcs.service import ShowFigures
from gcs.shows import Show, Timeline
from gcs.shows.library import ShowLibrary

log = logging.getLogger(__name__)

UNPACKED_MAX_BYTES: Final = 2_000_000
"""Of a show as JSON; its file has at most 64 KiB."""

AGAIN_S: Final = 5.0
"""Interval in which a drawing that is missing is looked for."""

_FIGURES: Final[TypeAdapter[ShowFigures | None]] = TypeAdapter(ShowFigures | None)


def packed(show_run: ShowRun) -> list[str]:
    """A show without its drawing as text, in parts that fit into a request."""
    about = {
        "name": show_run.name,
        "show": show_run.timeline.show.model_dump(mode="json"),
        "figures": _FIGURES.dump_python(show_run.figures, mode="json"),
    }
    text = b64encode(zlib.compress(json.dumps(about, separators=(",", ":")).encode())).decode()
    return [text[at : at + PART_MAX] for at in range(0, len(text), PART_MAX)]


def unpacked(parts: Sequence[str], show_hash: str) -> ShowRun:
    """The show of these parts. Raises: RefusedError when they are not the show of this hash."""
    try:
        reader = zlib.decompressobj()
        text = reader.decompress(b64decode("".join(parts), validate=True), UNPACKED_MAX_BYTES)
        read = json.loads(text)
        show = Show.model_validate_json(json.dumps(read["show"]))
        figures = _FIGURES.validate_python(read["figures"])
        if show.digest != show_hash:
            raise RefusedError(f"the show that arrived has the hash {show.digest}, not {show_hash[:64]}")
        return ShowRun(str(read["name"])[:60], Timeline.of(show), figures=figures, received=True)
    except (Base64Error, zlib.error, ValueError, LookupError, TypeError) as error:
        raise RefusedError(f"the show that arrived cannot be read: {error!r}"[:300]) from None


class ShowArrivals:
    """Puts the newest show together that another station sends. Used on the event loop only."""

    def __init__(self, library: ShowLibrary, reading: Executor) -> None:
        """`library` has the drawings, which `reading` reads: that takes up to seconds."""
        self._library, self._reading = library, reading
        self._parts: tuple[str, dict[int, str]] = ("", {})  # of a show, by its hash
        self._newest: ShowRun | None = None  # as it arrived, without its drawing
        self._read: Future[ShowRun | str] | None = None  # with it, or why that is not possible
        self._again_s = 0.0

    def take(self, part: ShowPart) -> None:
        """Note a part of a show; an unreadable show is logged."""
        if self._parts[0] != part.hash:
            self._parts = part.hash, {}
        parts = self._parts[1]
        parts[part.part] = part.text
        if len(parts) < min(part.parts, PARTS_MAX):
            return
        self._parts = "", {}
        try:
            self._newest = unpacked([parts[at] for at in sorted(parts)], part.hash)
            self._read = None
        except GcsError as refused:
            log.warning("show_unreadable", extra={"reason": str(refused)})

    def has(self, show_hash: str) -> bool:
        """Whether the show of this hash has arrived."""
        return self._newest is not None and self._newest.hash == show_hash

    def find(self, show_hash: str, now_s: float) -> ShowRun | None:
        """Return the show of this hash, ready to be flown; None: it has not arrived, or is being read.

        Raises: RefusedError when its drawing is not the one in this station's folder; it is looked for again.
        """
        newest = self._newest
        if newest is None or not self.has(show_hash):
            return None
        if newest.timeline.show.drawing is None:
            return newest
        if self._read is None:
            self._again_s = now_s + AGAIN_S
            self._read = self._reading.submit(self._with_drawing, newest)
        if not self._read.done():
            return None
        found = self._read.result()
        if isinstance(found, ShowRun):
            return found
        if now_s >= self._again_s:
            self._read = None
        raise RefusedError(found)

    def _with_drawing(self, show_run: ShowRun) -> ShowRun | str:
        """Return the show with its drawing, or why that is not possible. Called by another thread."""
        show = show_run.timeline.show
        try:
            return replace(show_run, timeline=Timeline.of(show, self._library.drawing_of(show)))
        except (ConfigError, RefusedError) as refused:
            return str(refused)
