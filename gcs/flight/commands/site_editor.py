"""Reads and replaces the file of the site, on the ground; no start is possible until it is in force.

What a service keeps of a site is settled when it starts: filter, planner, checks, return heights, the fence
in the autopilots. A changed site therefore counts from the next start of the service on.
"""

import asyncio
import contextlib
import logging
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Final, cast

from pydantic import ValidationError

from gcs.areas.files import geojson
from gcs.areas.files.reading import Heights
from gcs.areas.files.site_files import FORMATS, SIZE_MAX_BYTES, read_site, written
from gcs.areas.site import FlightSite, SiteArea, corners_m
from gcs.config.schema import Config, within_site
from gcs.config.setting_errors import explained
from gcs.flight.state.feature import Feature, Instant
from gcs.flight.state.show_state import ShowState
from gcs.flight.state.vehicle import FlightVehicles
from gcs.model.errors import ConfigError, InvalidError, RefusedError, SiteError, UnknownError
from gcs.model.frames import ShowFrame
from gcs.model.lifecycle import ShowPhase
from gcs.model.preflight_report import Check, State
from gcs.service import CALLER, SiteFormat, SiteView
from gcs.service.features import SiteFileView
from gcs.service.site_view import SiteAreaKind, SiteAreaView, SiteCorner

log = logging.getLogger(__name__)

NO_SITE: Final = "this service has no site: name its file in the configuration, site: FILE.geojson"
PENDING: Final = "the site in {file} is not the one in force: it counts from the next start of the service on"
START_AGAIN: Final = "end this service and start it again; or restore the file"
CHANGED: Final = "the site's file was changed since you read it: read it again, and make your change there"
SEVERAL: Final = (
    "several stations fly this site: change its file by gcs site or an editor, and start all of them again"
)
RESTING: Final = frozenset({ShowPhase.IDLE, ShowPhase.LANDED})


def why_not_now(show: ShowState, vehicles: FlightVehicles, *, alone: Callable[[], bool]) -> str:
    """Why the site cannot be changed now; empty: it can. `alone`: whether no vehicle is flown elsewhere."""
    if not alone():
        return SEVERAL
    if show.phase not in RESTING or vehicles.airborne:
        flying = f", {len(vehicles.airborne)} vehicles fly" if vehicles.airborne else ""
        return f"the site is changed on the ground, and the show is {show.phase}{flying}"
    return ""


def misfit_of(config: Config, site: FlightSite, path: Path) -> Sequence[str]:
    """Return why the configuration cannot fly within that site; empty: it can."""
    try:
        within_site(config, site, path)
    except SiteError as error:
        return error.problems
    except ValidationError as error:
        return [str(explained(error, "the configuration", Config, None))]
    return ()


@dataclass(frozen=True, slots=True)
class _Stored:
    """The file as it was read."""

    site: FlightSite
    version: str


class SiteEditor(Feature):
    """Implements `gcs.service.SiteFile`; as a feature it refuses starts while another site is stored."""

    name = "site"

    def __init__(
        self,
        path: Path | None,
        in_force: FlightSite | None,
        frame: ShowFrame,
        misfit: Callable[[FlightSite, Path], Sequence[str]],
        why_not: Callable[[], str],
    ) -> None:
        """Make it; reads nothing yet.

        Args:
            path: the file that the configuration names; None: none.
            in_force: the site that was read of it.
            frame: the show frame.
            misfit: why the configuration cannot fly within a site; empty: it can.
            why_not: why nothing can be changed now; empty: it can.
        """
        self._path = path
        self._in_force = in_force
        self._frame = frame
        self._misfit = misfit
        self._why_not = why_not
        self._version = self._pending = ""
        self._turn = asyncio.Lock()

    # as a feature

    def checks(self, at: Instant) -> Iterator[Check]:  # noqa: ARG002
        """Whether the site that is stored is in force; only where there is a site."""
        if self._in_force is not None:
            state = State.FAIL if self._pending else State.PASS
            to_do = START_AGAIN if self._pending else ""
            yield Check("site in force", state, problem=self._pending, to_do=to_do)

    def view(self, at: Instant) -> SiteFileView | None:  # noqa: ARG002
        if self._in_force is None:
            return None
        return SiteFileView(self._in_force.digest, self._version, self._pending)

    # as a role of the port

    async def read(self) -> SiteView:
        """As of the port."""
        path, _ = self._need()
        async with self._turn:
            return self._noted(path, await asyncio.to_thread(_read, path))

    async def text(self, form: SiteFormat) -> bytes:
        """As of the port."""
        path, _ = self._need()
        stored = await asyncio.to_thread(_read, path)
        return FORMATS[f".{form}"].write(stored.site)

    async def change(self, text: bytes, version: str) -> SiteView:
        """As of the port. Starts are refused before the file is written, and again possible if it is not."""
        path, in_force = self._need()
        self._need_now()
        async with self._turn:
            site, data = await asyncio.to_thread(self._made, text, path)
            stored = await asyncio.to_thread(_read_bytes, path)
            if version != _version(stored):
                raise RefusedError(CHANGED)
            self._need_now()  # a start may have come since
            before, self._pending = self._pending, self._why_pending(site, path)
            try:
                await asyncio.to_thread(_replace, path, stored, data)
            except OSError as error:
                self._pending = before
                text_of = f"{path.name} cannot be written: {error.strerror or error}; nothing has changed"
                raise RefusedError(text_of) from None
            if site.digest != in_force.digest:
                log.warning("site_changed", extra={"file": path.name, "by": CALLER.get()})
            return self._noted(path, _Stored(site, _version(data)))

    def _need(self) -> tuple[Path, FlightSite]:
        if self._path is None or self._in_force is None:
            raise UnknownError(NO_SITE)
        return self._path, self._in_force

    def _need_now(self) -> None:
        if why := self._why_not():
            raise RefusedError(why)

    def _made(self, text: bytes, path: Path) -> tuple[FlightSite, bytes]:
        """The site as it will be read, and the bytes of its file. Raises: InvalidError with all problems."""
        if len(text) > SIZE_MAX_BYTES:
            raise InvalidError("body", f"{len(text)} bytes", f"at most {SIZE_MAX_BYTES} bytes")
        try:
            site = geojson.read(text, "site", Heights())
            data = written(site, path)
        except ConfigError as error:
            raise _refusal(error.problems if isinstance(error, SiteError) else (str(error),)) from None
        if problems := self._misfit(site, path):
            raise _refusal(problems)
        return site, data

    def _why_pending(self, site: FlightSite, path: Path) -> str:
        same = self._in_force is not None and site.digest == self._in_force.digest
        return "" if same else PENDING.format(file=path.name)

    def _noted(self, path: Path, stored: _Stored) -> SiteView:
        _, in_force = self._need()
        self._version, self._pending = stored.version, self._why_pending(stored.site, path)
        site = stored.site
        areas = tuple(_area_view(area, self._frame) for area in site.areas)
        return SiteView(
            site.name, path.name, site.digest, stored.version, in_force.digest, self._pending, areas
        )


def _refusal(problems: Sequence[str]) -> InvalidError:
    """One problem a line, each with its area and corner."""
    return InvalidError("site", "as it was sent", "\n".join(problems))


def _area_view(area: SiteArea, frame: ShowFrame) -> SiteAreaView:
    places_m = corners_m(frame, area).tolist()
    corners = tuple(SiteCorner(*at, *place_m) for at, place_m in zip(area.corners, places_m, strict=True))
    kind = cast("SiteAreaKind", str(area.kind))
    return SiteAreaView(kind, area.name, corners, area.height_min_m, area.height_max_m)


def _version(data: bytes) -> str:
    return sha256(data).hexdigest()


def _read_bytes(path: Path) -> bytes:
    """Raises: RefusedError."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise RefusedError(f"{path.name} cannot be read: {error.strerror or error}") from None


def _read(path: Path) -> _Stored:
    """Raises: RefusedError when the file is no site any more."""
    version = _version(_read_bytes(path))
    try:
        return _Stored(read_site(path), version)
    except ConfigError as error:
        raise RefusedError(f"the site's file cannot be used, correct it: {error}") from None


def _replace(path: Path, before: bytes, data: bytes) -> None:
    """Write the file at once, with the old one beside it as .bak. Raises: OSError; the file is as before."""
    for name, content in ((f"{path.name}.bak", before), (path.name, data)):
        target, part = path.with_name(name), path.with_name(f"{path.name}.part")
        try:
            with part.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            part.replace(target)
        except OSError:
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)
            raise
