"""Messages of the console's stream, made once per state for all viewers."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from gcs.api.map_tiles import GroundMap
from gcs.api.schemas import binary_frame as frames
from gcs.api.schemas import convert
from gcs.api.schemas.fleet import Status
from gcs.service import FleetView, Service

STATUS_S: Final = 0.5
"""Least seconds between two status messages."""


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
            None if selected is None else replace(selected, clock_s=0.0),
            None if playback is None else replace(playback, position_s=0.0),
            (view.interrupted, view.alarms),
            events[-1].number if events else 0,
            list(rows.reasons),
            list(rows.limited_by),
            [None if home_m is None else home_m.tolist() for home_m in rows.homes_m],
            convert.fixes(rows),
        )
