"""State of one app: the service, and what must be remembered between two requests."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from typing import Annotated, Final, cast

from fastapi import Depends
from starlette.requests import HTTPConnection

from gcs.api.auth.authorization import Authorization, KillSwitch
from gcs.api.console_feed import Feed
from gcs.api.map_tiles import GroundMap
from gcs.api.schemas import convert
from gcs.model.errors import RefusedError
from gcs.model.frames import ShowFrame
from gcs.model.plan import Plan
from gcs.service import FleetView, Service

VIEWERS_MAX: Final = 32
"""Most viewers: each costs time of the event loop, and memory for what it has not read yet."""


class Context:
    """The service as requests see it."""

    def __init__(
        self, service: Service, authorization: Authorization, ground: GroundMap | None = None
    ) -> None:
        self.service = service
        self.ground = ground
        self.authorization = authorization
        self.kill_switch = KillSwitch()
        self.feed = Feed(service, authorization.text, self.health_problem, ground)
        self.emergency_port: int | None = None  # of the emergency listener, once it listens
        self._text = ""
        self._text_of: tuple[FleetView, str] | None = None
        self._viewers = 0
        self._numbers = count(1)

    @property
    def view(self) -> FleetView:
        return self.service.view.value

    @property
    def frame(self) -> ShowFrame:
        return self.service.frame

    @property
    def plan(self) -> Plan:
        """The plan as of now: a client reads what it has just written."""
        return self.service.plan.current

    def now_s(self) -> float:
        """Time of the event loop, the clock of the service."""
        return asyncio.get_running_loop().time()

    def age_s(self) -> float:
        return self.now_s() - self.view.time_s

    def health_problem(self) -> str:
        """Why control is not alive now; empty when it is."""
        return convert.health_problem(self.view, self.now_s())

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
