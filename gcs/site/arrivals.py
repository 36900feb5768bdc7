"""Shows that arrive from other stations over the bus; their drawings come from this station's folder."""

import logging
from concurrent.futures import Executor, Future
from dataclasses import replace
from typing import Final

from gcs.flight.state.running_show import ShowRun
from gcs.model.errors import ConfigError, RefusedError
from gcs.shows import Timeline
from gcs.shows.library import ShowLibrary
from gcs.shows.packed import packed, unpacked_apart
from gcs.site.requests import PART_MAX, PARTS_MAX, ShowPart

log = logging.getLogger(__name__)

AGAIN_S: Final = 5.0
"""Interval in which a drawing that is missing is looked for."""


def parts_of(show_run: ShowRun) -> list[str]:
    """A show without its drawing as text, in parts that fit into a request. Raises: RefusedError."""
    text = packed(show_run.name, show_run.timeline.show, show_run.figures)
    return [text[at : at + PART_MAX] for at in range(0, len(text), PART_MAX)]


def _read(parts: dict[int, str], show_hash: str) -> ShowRun | str:
    """Return the show of these parts, or why there is none. Called by another thread."""
    try:
        name, show, figures = unpacked_apart("".join(parts[at] for at in sorted(parts)), show_hash)
    except (RefusedError, OSError) as refused:
        return str(refused)
    return ShowRun(name, Timeline.of(show), figures=figures, received=True)


class ShowArrivals:
    """Puts the newest show together that another station sends. Used on the event loop only."""

    def __init__(self, library: ShowLibrary, reading: Executor) -> None:
        """`library` has the drawings. `reading` reads them and unpacks shows: each takes up to seconds."""
        self._library, self._reading = library, reading
        self._parts: tuple[str, dict[int, str]] = ("", {})  # of a show, by its hash
        self._whole: tuple[str, dict[int, str]] | None = None  # the newest that is not unpacked yet
        self._unpacking: tuple[str, Future[ShowRun | str]] | None = None  # one at a time, by its hash
        self._newest: ShowRun | None = None  # as it arrived, without its drawing
        self._read: Future[ShowRun | str] | None = None  # with it, or why that is not possible
        self._again_s = 0.0

    def take(self, part: ShowPart) -> None:
        """Note a part of a show."""
        if self._parts[0] != part.hash:
            self._parts = part.hash, {}
        parts = self._parts[1]
        parts[part.part] = part.text
        if len(parts) >= min(part.parts, PARTS_MAX):
            self._whole, self._parts = self._parts, ("", {})
            self._unpack()

    def _unpack(self) -> None:
        """Take what has been unpacked, and have the next one unpacked. An unreadable show is logged."""
        if self._unpacking is not None:
            if not self._unpacking[1].done():
                return
            outcome, self._unpacking = self._unpacking[1].result(), None
            if isinstance(outcome, ShowRun):
                self._newest, self._read = outcome, None
            else:
                log.warning("show_unreadable", extra={"reason": outcome})
        if self._whole is not None:
            (show_hash, parts), self._whole = self._whole, None
            self._unpacking = show_hash, self._reading.submit(_read, parts, show_hash)

    def has(self, show_hash: str) -> bool:
        """Whether the show of this hash has arrived, as far as its sender says until it is unpacked."""
        if self._newest is not None and self._newest.hash == show_hash:
            return True
        return any(
            arrived is not None and arrived[0] == show_hash for arrived in (self._whole, self._unpacking)
        )

    def find(self, show_hash: str, now_s: float) -> ShowRun | None:
        """Return the show of this hash, ready to be flown; None: it has not arrived, or is being read.

        Raises: RefusedError when its drawing is not the one in this station's folder; it is looked for again.
        """
        self._unpack()
        newest = self._newest
        if newest is None or newest.hash != show_hash:
            return None
        if newest.timeline.show.drawing is None:
            return newest
        if self._read is None:
            self._again_s = now_s + AGAIN_S
            self._read = self._reading.submit(self._with_drawing, newest)
        if not self._read.done():
            return None
        outcome = self._read.result()
        if isinstance(outcome, ShowRun):
            return outcome
        if now_s >= self._again_s:
            self._read = None
        raise RefusedError(outcome)

    def _with_drawing(self, show_run: ShowRun) -> ShowRun | str:
        """Return the show with its drawing, or why that is not possible. Called by another thread."""
        show = show_run.timeline.show
        try:
            return replace(show_run, timeline=Timeline.of(show, self._library.drawing_of(show)))
        except (ConfigError, RefusedError) as refused:
            return str(refused)
