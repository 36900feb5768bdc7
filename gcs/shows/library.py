"""The stored show files and their checks; each check runs in its own process beside the flight.

Files are read and written in a thread, because a slow disk must not delay a tick. A check is `gcs show check`
on a copy of the file, at the lowest priority. Its result is kept in memory: after a restart a show is
checked again before it is flown.
"""

import asyncio
import contextlib
import json
import logging
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from pydantic import TypeAdapter

from gcs.config.yaml_files import Source
from gcs.model.errors import ConfigError, GcsError, InvalidError, Problem, RefusedError, UnknownError
from gcs.service import CheckState, ShowCheck, StoredShow
from gcs.service.check_process import answered
from gcs.service.folder_lock import in_turn
from gcs.service.snapshots import ShowFigures
from gcs.shows import Flaw, Show, Timeline, stored_drawings
from gcs.shows.drawn import DrawnShow
from gcs.shows.following import load_assignment
from gcs.shows.format import Drawing
from gcs.shows.formats import read_drawing
from gcs.shows.loading import parse, placed
from gcs.shows.service_rules import ServiceRules

log = logging.getLogger(__name__)

SIZE_MAX_BYTES = 64 * 1024
"""Largest size of a show file; a long one has some tens of thousands of characters."""

FILES_MAX = 200
CHECKS_MAX = 2
"""One runs, one waits: the computer that runs the flight has little capacity to spare."""

CHECK_WITHIN_S = 900.0
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,59}")


@dataclass(frozen=True, slots=True, eq=False)
class _Checked:
    """A check, its file, and the show that may be flown if it is good."""

    reported: ShowCheck
    sha256: str | None = None  # of the file that was checked
    show: Show | None = None
    source: Source | None = None  # of the show
    drawing: DrawnShow | None = None  # of a show with drawn parts


NOT_KEPT: Final = "this service keeps no shows: name a folder in its configuration, shows.folder"


class ShowLibrary:
    """The shows of one folder, and their drawings beside them. Implements `gcs.service.Shows`."""

    def __init__(self, folder: Path | None, rules: ServiceRules | None = None) -> None:
        """`folder` is created with the first file; None: no show can be stored.

        `rules` are the station's, for the show files of imported drawings.
        """
        self._folder, self._rules = folder, rules or ServiceRules()
        self._checks: dict[str, _Checked] = {}
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._turn = asyncio.Lock()
        self._writing = asyncio.Lock()
        # Why this service would refuse a good show under its present settings; checks report it, too.
        self.misfits: Callable[[Show], Sequence[Flaw]] = lambda _: ()

    async def close(self) -> None:
        tasks = dict(self._tasks)
        for task in tasks.values():
            task.cancel()
        await asyncio.gather(*tasks.values(), return_exceptions=True)
        for name in tasks:
            self._failed(name, "the service has ended")

    # files

    @property
    def why_not_kept(self) -> str:
        return NOT_KEPT if self._folder is None else ""

    @property
    def rules(self) -> str:
        return self._rules.model_dump_json()

    async def list_shows(self) -> list[StoredShow]:
        return await asyncio.to_thread(self._listed)

    async def text(self, name: str) -> str:
        return (await asyncio.to_thread(self._read, name)).decode(errors="replace")

    async def store(self, name: str, text: bytes) -> StoredShow:
        _check_text(name, text)
        async with self._writing:
            return await asyncio.to_thread(self._write, name, text)

    async def store_drawn(self, name: str, text: bytes, drawing: Path) -> StoredShow:
        _check_text(name, text)
        source = stored_drawings.source_of(text)
        if source is None:
            raise InvalidError("body", "a show without a drawing", "a show that names its drawing")
        async with self._writing:
            return await asyncio.to_thread(self._write, name, text, (source, drawing))

    async def drawn_file(self, name: str) -> Path:
        if stored_drawings.source_of(await asyncio.to_thread(self._read, name)) is None:
            raise RefusedError(f"show {name!r} has no drawing")
        return self._place(name)

    async def remove(self, name: str) -> None:
        async with self._writing:
            await asyncio.to_thread(self._remove, name)

    def _place(self, name: str) -> Path:
        _check_name(name)
        if self._folder is None:
            raise RefusedError(NOT_KEPT)
        return self._folder / f"{name}.yaml"

    def _listed(self) -> list[StoredShow]:
        if self._folder is None:
            return []
        paths = [path for path in sorted(self._folder.glob("*.yaml")) if NAME.fullmatch(path.stem)]
        return [self._stored(path.stem, self._read(path.stem)) for path in paths[:FILES_MAX]]

    def _read(self, name: str) -> bytes:
        path = self._place(name)
        try:
            with path.open("rb") as file:
                text = file.read(SIZE_MAX_BYTES + 1)
        except FileNotFoundError:
            raise UnknownError(f"there is no show {name!r}: upload it first") from None
        except OSError as error:
            raise RefusedError(f"show {name!r} cannot be read: {error.strerror}") from None
        if len(text) > SIZE_MAX_BYTES:
            raise RefusedError(f"show {name!r} is larger than {SIZE_MAX_BYTES} bytes")
        return text

    def _write(self, name: str, text: bytes, drawing: tuple[str, Path] | None = None) -> StoredShow:
        """Write a show file; `drawing` is the name of its drawing, and the file to copy."""
        path = self._place(name)
        beside = path.with_suffix(".part")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with in_turn(path.parent):  # other services may keep their shows in the same folder
                replaced = path.exists()
                if not replaced and len(list(path.parent.glob("*.yaml"))) >= FILES_MAX:
                    raise RefusedError(f"there are {FILES_MAX} shows already: remove one")
                before = stored_drawings.named_by(path)
                if drawing is not None:
                    stored_drawings.keep(path.parent, *drawing)
                with beside.open("wb") as file:
                    file.write(text)
                    file.flush()
                    os.fsync(file.fileno())
                beside.replace(path)
                stored_drawings.drop_unnamed(path.parent, before)
        except OSError as error:
            with contextlib.suppress(OSError):
                beside.unlink(missing_ok=True)
            raise RefusedError(
                f"show {name!r} cannot be kept: {error.strerror}; nothing has changed"
            ) from None
        return self._stored(name, text, replaced=replaced)

    def _stored(self, name: str, text: bytes, *, replaced: bool = False) -> StoredShow:
        checked = self._checks.get(name)
        is_checked = checked is not None and checked.sha256 == sha256(text).hexdigest()
        show_hash = checked.reported.hash if checked is not None and is_checked else None
        return StoredShow(name, len(text), show_hash, stored_drawings.source_of(text), replaced)

    def _remove(self, name: str) -> None:
        path = self._place(name)
        try:
            with in_turn(path.parent):
                source = stored_drawings.named_by(path)
                path.unlink()
                stored_drawings.drop_unnamed(path.parent, source)
        except FileNotFoundError:
            raise UnknownError(f"there is no show {name!r}") from None
        except OSError as error:
            raise RefusedError(f"show {name!r} cannot be removed: {error.strerror}") from None

    # checks

    def check(self, name: str) -> ShowCheck:
        """Start a check. Raises: InvalidError; RefusedError while it, or too many others, are being run."""
        self._place(name)
        if name in self._tasks:
            raise RefusedError(f"show {name!r} is being checked already")
        if len(self._tasks) >= CHECKS_MAX:
            raise RefusedError(f"{CHECKS_MAX} shows are being checked: wait for {', '.join(self._tasks)}")
        self._checks[name] = _Checked(ShowCheck(name, CheckState.WAITING))
        task = asyncio.create_task(self._check(name), name=f"check/{name}")
        self._tasks[name] = task
        task.add_done_callback(lambda _: self._tasks.pop(name, None))
        return self._checks[name].reported

    def checked(self, name: str) -> ShowCheck:
        _check_name(name)
        if name not in self._checks:
            raise UnknownError(f"show {name!r} has not been checked since this service began: check it")
        return self._for_this_service(self._checks[name])

    def _for_this_service(self, checked: _Checked) -> ShowCheck:
        """Add the service's own reasons to refuse: evaluated on each call, because its obstacles change."""
        if checked.show is None or checked.source is None:
            return checked.reported
        source = checked.source
        unfit = [Problem(source.line(*flaw.loc), None, flaw.text) for flaw in self.misfits(checked.show)]
        if not unfit:
            return checked.reported
        problems = sorted((*checked.reported.problems, *unfit), key=lambda problem: problem.line)
        return replace(checked.reported, good=False, fits_service=False, problems=tuple(problems))

    async def _check(self, name: str) -> None:
        async with self._turn:
            self._checks[name] = _Checked(ShowCheck(name, CheckState.RUNNING))
            try:
                text = await asyncio.to_thread(self._read, name)
                answer = await _checked_in_process(name, text, self._place(name).parent, self.rules)
                self._checks[name] = await asyncio.to_thread(self._reported, name, text, answer)
            except TimeoutError:
                self._failed(name, f"not done within {CHECK_WITHIN_S:g} s")
            except (GcsError, OSError, ValueError, LookupError, TypeError) as error:  # or invalid output
                self._failed(name, str(error))

    def _failed(self, name: str, reason: str) -> None:
        log.warning("show_check_failed", extra={"show": name, "reason": reason})
        self._checks[name] = _Checked(ShowCheck(name, CheckState.FAILED, reason))

    def found(self, name: str, text: bytes, answer: dict[str, Any]) -> ShowCheck:
        """Store the output of `gcs show check --json --model` for a file with that text.

        Raises: ValueError (pydantic's) when the output is invalid.
        """
        self._checks[name] = self._reported(name, text, answer)
        return self.checked(name)

    def _reported(self, name: str, text: bytes, answer: Mapping[str, Any]) -> _Checked:
        """Convert the output of a check, and read the drawing of a show that is good.

        Raises: ValueError, TypeError or LookupError when the output is invalid; ConfigError or RefusedError
            when the drawing cannot be read, or has changed since.
        """
        checked = _reported(name, text, answer)
        if checked.show is None or checked.show.drawing is None or not checked.reported.good:
            return checked
        drawing = _drawing(checked.show.drawing, self._place(name).parent)
        load_assignment()  # here, in a thread: control assigns when the show starts
        return replace(checked, drawing=placed(drawing, checked.show))

    def cleared(self, name: str, show_hash: str) -> Timeline:
        """Return the timeline of a show that is cleared to fly. Reads the file, on the ground.

        Raises: UnknownError; RefusedError when it was never checked, is not good, or has changed since.
        """
        text = self._read(name)
        checked = self._checks.get(name)
        if checked is None or checked.reported.state is not CheckState.DONE:
            now = "" if checked is None else f" (its check: {checked.reported.state})"
            raise RefusedError(f"show {name!r} has not been checked{now}: check it first")
        if checked.sha256 != sha256(text).hexdigest():
            raise RefusedError(f"show {name!r} has changed since it was checked: check it again")
        if checked.show is None or not checked.reported.good:
            first = "; ".join(str(problem) for problem in checked.reported.problems[:2])
            raise RefusedError(f"show {name!r} is not good to fly: {first}")
        if checked.reported.hash != show_hash:
            raise RefusedError(
                f"show {name!r} was checked with the hash {checked.reported.hash}, not {show_hash[:64]!r}"
            )
        return Timeline.of(checked.show, checked.drawing)

    def outdated(self, name: str, show_hash: str) -> str:
        """Why the file is no longer the show that was selected with this hash; empty: it is, or is not known.

        Reads the file, on the ground.
        """
        try:
            text = self._read(name)
        except GcsError as error:
            return str(error)
        checked = self._checks.get(name)
        if checked is None or checked.reported.state is not CheckState.DONE:
            return ""
        if checked.sha256 != sha256(text).hexdigest():
            return f"show {name!r} has changed since it was checked"
        same = checked.reported.hash == show_hash
        return "" if same else f"show {name!r} was moved or changed since it was selected"

    def recorded(self, name: str, show_hash: str) -> Timeline:
        """Return the show that was flown under that hash before this service began. Reads the file.

        Raises: UnknownError; RefusedError when it cannot be read, or has changed since.
        """
        try:
            loaded = parse(self._read(name).decode(), str(self._place(name)))
        except (ConfigError, UnicodeDecodeError) as error:
            raise RefusedError(f"show {name!r} is not what was flown: {error}") from None
        if loaded.show.digest != show_hash:
            raise RefusedError(f"show {name!r} has changed since it was flown")
        return loaded.timeline

    def drawing_of(self, show: Show) -> DrawnShow | None:
        """Read the drawing, in this folder, of a show that another service checked: up to some seconds.

        Raises: RefusedError when it is missing, or another one; ConfigError when it cannot be read.
        """
        if show.drawing is None:
            return None
        if self._folder is None:
            raise RefusedError(NOT_KEPT)
        drawing = stored_drawings.read(self._folder, show.drawing.source, show.drawing.sha256)
        load_assignment()
        return placed(drawing, show)


def _check_name(name: str) -> None:
    if not NAME.fullmatch(name):
        raise InvalidError("name", name[:60], "1 to 60 of A-Z a-z 0-9 _ -, the first no _ or -")


def _check_text(name: str, text: bytes) -> None:
    _check_name(name)
    if not text.strip() or len(text) > SIZE_MAX_BYTES:
        allowed = f"a show in YAML, at most {SIZE_MAX_BYTES} bytes"
        raise InvalidError("body", f"{len(text)} bytes", allowed)
    try:
        text.decode()
    except UnicodeDecodeError as error:
        raise InvalidError("body", str(error), "a show in YAML, in UTF-8") from None


_FIGURES: Final = TypeAdapter(ShowFigures)


def _reported(name: str, text: bytes, answer: Mapping[str, Any]) -> _Checked:
    """Convert the output of a check. Raises: ValueError, TypeError or LookupError when it is invalid."""
    model = answer.get("model")
    show = None if model is None else Show.model_validate_json(json.dumps(model))
    reported = ShowCheck(
        name,
        CheckState.DONE,
        hash=None if show is None else show.digest,
        good=bool(answer["good"]) and show is not None,
        problems=tuple(Problem(**problem) for problem in answer["problems"]),
        figures=None if show is None else _FIGURES.validate_python(answer),
    )
    source = None if show is None else Source(text.decode(), name)
    return _Checked(reported, sha256(text).hexdigest(), show, source)


def _drawing(named: Drawing, folder: Path) -> DrawnShow:
    """Read a drawing. Raises: ConfigError; RefusedError when it is not the one that was checked."""
    drawing, data = read_drawing(folder / named.source)
    if sha256(data).hexdigest() != named.sha256:
        raise RefusedError(f"{named.source} has changed since it was checked")
    return drawing


async def _checked_in_process(name: str, text: bytes, kept: Path, rules: str) -> dict[str, Any]:
    """Run `gcs show check` on a text with its drawing, if it names one, of the folder `kept`.

    `rules` are those of the service, as JSON.

    Raises: RefusedError, OSError, TimeoutError, ValueError.
    """
    source = stored_drawings.source_of(text)
    with tempfile.TemporaryDirectory(prefix="gcs-check-") as folder:
        path = Path(folder) / f"{name}.yaml"
        path.write_bytes(text)
        if source is not None and (kept / source).is_file():
            await asyncio.to_thread(shutil.copyfile, kept / source, path.with_name(source))
        try:
            arguments = ("show", "check", str(path), "--json", "--model", f"--rules={rules}")
            return await answered(arguments, CHECK_WITHIN_S)
        except RefusedError as refused:
            raise RefusedError(str(refused).replace(f"{path}: ", "")) from None
