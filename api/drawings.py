"""Imports, samples and places drawings for requests.

The work is done by `gcs show` in subprocesses of the API's, so that control parses no uploaded file and sends
no preview. They have a low priority while anything flies.
"""

import asyncio
import json
import tempfile
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from http import HTTPStatus
from math import isfinite
from pathlib import Path
from typing import Any, Final

from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request

from gcs.model.errors import InvalidError, RefusedError
from gcs.model.frames import ShowFrame
from gcs.model.lifecycle import ON_THE_GROUND, Phase, ShowPhase
from gcs.service import DRAWING_MAX_BYTES, Shows
from gcs.service.check_process import LOWER, USUAL, EndedError, printed
from gcs.service.vehicle_table import VehicleTable

WAITING_MAX: Final = 4
"""Requests at once; one of them is worked on."""

UPLOAD_S: Final = 120.0
"""Seconds for a whole drawing to arrive."""

WORK_S: Final = 120.0
"""Seconds for a subprocess: beside a flight it waits for every other one."""

SAMPLES_MAX_BYTES: Final = 8 * 1024**2


@dataclass(frozen=True, slots=True)
class Upload:
    """What a drawing is uploaded as."""

    name: str  # of the show
    format: str  # suffix of the drawing's file
    at_service: bool  # the service's origin replaces the drawing's own


@dataclass(frozen=True, slots=True)
class Place:
    """A placement of a drawn show; None: as stored."""

    show: Path  # its file
    x_m: float | None = None
    y_m: float | None = None
    turn_deg: float | None = None
    fits: bool = False  # from there on, to where the vehicles stand


class Drawings:
    """The drawings' work of one app. Use it only on the event loop."""

    def __init__(
        self, frame: ShowFrame, phase: Callable[[], ShowPhase], rules: Callable[[], str] = str
    ) -> None:
        """Note what the work needs of the service.

        Args:
            frame: the service's, for drawings that name no place on Earth.
            phase: returns the show's now.
            rules: returns those of `gcs.service.Shows`.
        """
        origin = frame.latitude_deg, frame.longitude_deg, frame.altitude_amsl_m, frame.heading_deg
        self._origin = ",".join(map(str, origin))
        self._phase, self._rules = phase, rules
        self._turn = asyncio.Lock()
        self._waiting = 0

    async def imported(self, upload: Upload, request: Request, shows: Shows) -> dict[str, Any]:
        """Store the drawing in a request's body as a show. Returns: what `gcs show import --json` prints.

        Raises: InvalidError, with the place in the file; RefusedError; HTTPException for a body that is too
        large or too slow.
        """
        if shows.why_not_kept:
            raise RefusedError(shows.why_not_kept)
        with tempfile.TemporaryDirectory(prefix="gcs-import-") as folder:
            given = Path(folder) / f"{upload.name}.{upload.format}"
            async with self._place():
                await _received(request, given)
                async with self._turn:
                    found = await self._parsed(upload, given)
                target = given.with_suffix(".yaml")
                text = await asyncio.to_thread(target.read_bytes)
                stored = await shows.store_drawn(upload.name, text, given)
        return found | {"replaced": stored.replaced}

    async def _parsed(self, upload: Upload, given: Path) -> dict[str, Any]:
        option = "--origin" if upload.at_service else "--origin-else"
        target = str(given.with_suffix(".yaml"))
        options = f"{option}={self._origin}", f"--rules={self._rules()}", "--json"
        arguments = "show", "import", str(given), "-o", target, *options
        try:
            found: dict[str, Any] = json.loads(await self._printed(arguments))
        except EndedError as ended:
            words = ended.words.replace(f"{given.parent}/", "")
            raise InvalidError("body", given.name, words) from None
        return found | {"show": upload.name, "drawing": given.name}

    async def sampled(self, show: Path, from_s: float, to_s: float | None, rate_hz: float) -> bytes:
        """Return what `gcs show sample --json` prints for a show file. Raises: InvalidError, RefusedError."""
        until = () if to_s is None else (f"--to={to_s}",)
        arguments = "show", "sample", str(show), f"--from={from_s}", *until, f"--rate={rate_hz}", "--json"
        try:
            async with self._place(), self._turn:
                return await self._printed(arguments)
        except EndedError as ended:
            raise RefusedError(ended.words.replace(f"{show.parent}/", "")) from None

    async def placement(self, place: Place, rows: VehicleTable) -> dict[str, Any]:
        """Return what `gcs show place --json` prints, with the vehicles of `rows` that are on the ground.

        Raises: RefusedError.
        """
        return (await self._placement(place, rows, writes=False))[0]

    async def placed(self, place: Place, rows: VehicleTable) -> tuple[dict[str, Any], bytes]:
        """As `placement`, and the show file with that placement. Raises: RefusedError."""
        return await self._placement(place, rows, writes=True)

    async def _placement(
        self, place: Place, rows: VehicleTable, *, writes: bool
    ) -> tuple[dict[str, Any], bytes]:
        at = ",".join(
            "" if value is None else repr(value) for value in (place.x_m, place.y_m, place.turn_deg)
        )
        with tempfile.TemporaryDirectory(prefix="gcs-place-") as folder:
            vehicles, written = Path(folder) / "vehicles.json", Path(folder) / place.show.name
            vehicles.write_text(json.dumps(_on_the_ground(rows)))
            options = (
                *("--json", f"--at={at}", f"--frame={self._origin}", f"--vehicles={vehicles}"),
                f"--rules={self._rules()}",
                *(("--fit",) if place.fits else ()),
                *((f"--output={written}",) if writes else ()),
            )
            try:
                async with self._place(), self._turn:
                    found: dict[str, Any] = json.loads(
                        await self._printed(("show", "place", str(place.show), *options))
                    )
            except EndedError as ended:
                raise RefusedError(ended.words.replace(f"{place.show.parent}/", "")) from None
            text = await asyncio.to_thread(written.read_bytes) if writes else b""
        return found, text

    @asynccontextmanager
    async def _place(self) -> AsyncIterator[None]:
        """Hold one place of those that wait. Raises: RefusedError when all are taken."""
        if self._waiting >= WAITING_MAX:
            raise RefusedError(f"{WAITING_MAX} drawings are being read: try again in some seconds")
        self._waiting += 1
        try:
            yield
        finally:
            self._waiting -= 1

    async def _printed(self, arguments: tuple[str, ...]) -> bytes:
        """Raises: EndedError when the command fails; RefusedError for all other failures."""
        priority = USUAL if self._phase() in ON_THE_GROUND else LOWER
        try:
            return await printed(arguments, WORK_S, priority, codes=(0,), answer_max_bytes=SAMPLES_MAX_BYTES)
        except TimeoutError:
            raise RefusedError(f"the drawing was not read within {WORK_S:g} s: try again") from None
        except OSError as error:
            words = f"no process could be started to read the drawing: {error.strerror}"
            raise RefusedError(words) from None


def _on_the_ground(rows: VehicleTable) -> dict[str, list[float] | None]:
    """Return where vehicles stand, by name, in the fleet's order; None: not on the ground, or not known."""
    return {
        name: place_m if phase is Phase.STANDBY and all(map(isfinite, place_m)) else None
        for name, phase, place_m in zip(rows.ids, rows.phases, rows.position_m[:, :2].tolist(), strict=True)
    }


async def _received(request: Request, given: Path) -> None:
    """Write a request's body to a file. Raises: HTTPException, InvalidError when there is none."""
    size = 0
    try:
        with given.open("wb") as file:
            async with asyncio.timeout(UPLOAD_S):
                async for piece in request.stream():
                    size += len(piece)
                    if size > DRAWING_MAX_BYTES:
                        text = f"the body is larger than {DRAWING_MAX_BYTES} bytes"
                        raise HTTPException(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, text)
                    await asyncio.to_thread(file.write, piece)
    except TimeoutError:
        text = f"the body did not come within {UPLOAD_S:g} s"
        raise HTTPException(HTTPStatus.REQUEST_TIMEOUT, text) from None
    except ClientDisconnect:
        raise HTTPException(HTTPStatus.BAD_REQUEST, "the body is incomplete") from None
    except OSError as error:
        raise RefusedError(f"the drawing cannot be kept: {error.strerror}") from None
    if not size:
        raise InvalidError("body", "0 bytes", "the file of a drawing")
