"""State of one app: the service, what the console's stream sends, and what requests must remember."""

import asyncio
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import count
from typing import Annotated, Final, cast

from fastapi import Depends
from starlette.requests import HTTPConnection

from gcs.api.auth.authorization import Authorization, KillSwitch
from gcs.api.drawings import Drawings
from gcs.api.map_tiles import GroundMap
from gcs.api.schemas import binary_frame as frames
from gcs.api.schemas import convert
from gcs.api.schemas.fleet import FRAME_COLUMNS, Status
from gcs.model.errors import LinkError, RefusedError
from gcs.model.plan import Plan
from gcs.model.state import VehicleId
from gcs.service import CommandRecord, FleetView, SelectedShow, Service
from gcs.service.interface import LastResort

STATUS_S: Final = 0.5
"""Least seconds between two status messages."""

VIEWERS_MAX: Final = 32
"""Most viewers: each costs time of the event loop, and memory for what it has not read yet."""


def _slowly(selected: SelectedShow) -> SelectedShow:
    """Return the show without what moves by itself."""
    begin = None if selected.begin is None else replace(selected.begin, in_s=None)
    return replace(selected, clock_s=0.0, begin=begin)


class Feed:
    """Frames and status of one service. Use it only on the event loop."""

    def __init__(
        self, service: Service, access: str, problem: Callable[[], str], ground: GroundMap | None = None
    ) -> None:
        """`access` is `Authorization.text`; `problem` says why control is not alive now, empty when it is."""
        self._service = service
        self._access = access
        self._problem = problem
        self._ground = ground
        self._began_unix_s = time.time()
        self._sent: object = None  # content of the newest status, without what a frame contains as well
        self._made_s = 0.0
        self._status = ""
        self._revision = 0
        self._frame = b""
        self._frame_of: tuple[FleetView, bool, int] | None = None

    def status(self, now_s: float) -> tuple[int, str]:
        """Return revision and JSON text of the newest status; changes appear within `STATUS_S`."""
        if not self._revision or now_s - self._made_s >= STATUS_S:
            self._made_s = now_s
            content = self._content()
            if content != self._sent:
                self._sent = content
                self._revision += 1
                self._status = self.newest().model_dump_json()
        return self._revision, self._status

    def newest(self) -> Status:
        service, view = self._service, self._service.view.value
        return Status(
            **convert.summary(view, service.frame, self._problem(), self._access),
            revision=self._revision,
            began_unix_time_s=self._began_unix_s,
            timeline=[] if view.selected is None else list(view.selected.timeline),
            shows_refused=service.shows.why_not_kept,
            map=self._ground,
            flight_envelope=view.flight_envelope,
            limits=sorted(set(view.rows.limited_by) - {""}),
            replay=view.playback,
            events=list(service.events.newest()),
            columns=FRAME_COLUMNS,
            vehicles=convert.records(view.rows),
        )

    def frame(self) -> bytes:
        view, alive = self._service.view.value, not self._problem()
        if (
            self._frame_of is None
            or self._frame_of[0] is not view
            or self._frame_of[1:] != (alive, self._revision)
        ):
            self._frame = frames.encode(view, self._service.frame, revision=self._revision, alive=alive)
            self._frame_of = view, alive, self._revision
        return self._frame

    def _content(self) -> object:
        view, events = self._service.view.value, self._service.events.newest()
        rows, selected, playback = view.rows, view.selected, view.playback
        return (
            self._problem(),
            (view.show, view.reason, view.plan, view.flight_envelope, view.start_unix_time_s),
            view.start_refused,
            None if selected is None else _slowly(selected),
            {name: each.at_rest() for name, each in view.features.reporting.items()},
            None if playback is None else replace(playback, position_s=0.0),
            (view.interrupted, view.alarms),
            events[-1].number if events else 0,
            [replace(station, silent_s=None, delay_s=None) for station in view.stations],
            list(rows.stations),
            list(rows.reasons),
            list(rows.limited_by),
            [None if home_m is None else home_m.tolist() for home_m in rows.homes_m],
            convert.fixes(rows),
        )


class Context:
    """The service as requests see it."""

    def __init__(
        self, service: Service, authorization: Authorization, ground: GroundMap | None = None
    ) -> None:
        self.service = service
        self.ground, self.frame = ground, service.frame
        self.authorization = authorization
        self.kill_switch = KillSwitch()
        self.drawings = Drawings(service.frame, lambda: self.view.show, lambda: service.shows.rules)
        self.feed = Feed(service, authorization.text, self.health_problem, ground)
        self.last_resort: LastResort | None = None  # None: a kill needs control
        self.emergency_port: int | None = None  # of the emergency listener, once it listens
        self._text = ""
        self._text_of: tuple[FleetView, str] | None = None
        self._viewers = 0
        self._numbers = count(1)

    @property
    def view(self) -> FleetView:
        return self.service.view.value

    @property
    def plan(self) -> Plan:
        """The plan as of now: a client reads what it has just written."""
        return self.service.plan.current

    async def kill(self, vehicles: Sequence[VehicleId]) -> CommandRecord:
        """Kill vehicles by control, or without it when it does not answer. Raises: LinkError."""
        try:
            return self.service.commands.kill(vehicles)
        except LinkError:
            if self.last_resort is None:
                raise
            return await self.last_resort.kill(vehicles)

    def command_record(self, command_id: str) -> CommandRecord:
        """Return an accepted command. Raises: UnknownError, LinkError."""
        found = None if self.last_resort is None else self.last_resort.find(command_id)
        return found or self.service.command_log.get(command_id)

    def now_s(self) -> float:
        return asyncio.get_running_loop().time()

    def age_s(self) -> float:
        return self.now_s() - self.view.time_s

    def health_problem(self) -> str:
        """Why control is not alive now; empty when it is."""
        return convert.health_problem(self.view, self.now_s())

    def elsewhere(self, vehicles: Sequence[VehicleId] | None = None) -> dict[VehicleId, str]:
        """Of these vehicles (None: all) those that another station flies, and its name; "": none is known."""
        view = self.view
        own = next((station.name for station in view.stations if station.own), "")
        if not own:
            return {}
        owners = dict(zip(view.rows.ids, view.rows.stations, strict=True))
        named = owners if vehicles is None else vehicles
        return {name: owners[name] for name in named if owners.get(name, own) != own}

    def fleet_json(self) -> str:
        """The whole state as JSON text, made once per state for all viewers."""
        view, problem = self.view, self.health_problem()
        if self._text_of is None or self._text_of[0] is not view or self._text_of[1] != problem:
            fleet = convert.fleet(view, self.frame, problem, self.authorization.text)
            self._text, self._text_of = fleet.model_dump_json(), (view, problem)
        return self._text

    def new_obstacle_id(self) -> str:
        """Return an id that no obstacle has and that was never given before."""
        taken = {box.id for box in self.plan.obstacles}
        return next(name for number in self._numbers if (name := f"box-{number}") not in taken)

    @contextmanager
    def viewer_slot(self) -> Iterator[None]:
        """Hold one viewer slot. Raises: RefusedError when all are taken."""
        if self._viewers >= VIEWERS_MAX:
            raise RefusedError(f"{VIEWERS_MAX} viewers watch already: close one of them")
        self._viewers += 1
        try:
            yield
        finally:
            self._viewers -= 1


async def _context_of(connection: HTTPConnection) -> Context:
    return cast("Context", connection.app.state.context)


ContextDep = Annotated[Context, Depends(_context_of)]
