"""The vehicles and the formation's centre as tracks of TAK: each once a second, if its place is believed."""

import asyncio
from collections.abc import Callable, Iterator
from math import ceil, inf, isnan, nan
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.config.schema import Config
from gcs.flight.state.feature import Feature, Instant
from gcs.flight.state.newest import Newest
from gcs.flight.state.vehicle import FlightVehicles
from gcs.links.tak.events import FUSED, MEASURED, OwnTrack, event
from gcs.links.tak.sender import CotSender
from gcs.model.state import Array, Mask
from gcs.service.alarms import AlarmCause, Condition
from gcs.service.features import TakReceiverView, TakView

EVERY_S: Final = 1.0
AT_ONCE: Final = 50
"""So many vehicles are sent in a tick, unless a second has too few ticks for all."""

SHOWN_MAX: Final = 3
NO_CLOCK: Final = "this computer's clock is not synchronised: timedatectl, or tak.require_clock: false"


class TakTracks(Feature):
    """The tracks of one station: of the vehicles that it flies, and of the centre if it leads."""

    name = "tak"

    def __init__(
        self,
        config: Config,
        newest: Newest,
        vehicles: FlightVehicles,
        owned: Callable[[], Mask],
        leads: Callable[[], bool],
        unix_s: Callable[[], float],
        unix_minus_loop_s: Callable[[], float],
    ) -> None:
        """Send nothing yet.

        Args:
            config: with or without a section `tak`.
            newest: of the flight.
            vehicles: all of the flight.
            owned: (n,) those that this station flies.
            leads: whether this station leads the formation.
            unix_s: this computer's clock, since 1970.
            unix_minus_loop_s: the same minus the loop's; NaN: it is not to be trusted.
        """
        self._settings, self._frame = config.tak, config.frame
        self._uid, self._age_max_s = config.own_tracks.uid, config.control.telemetry_age_max_s
        self._newest, self._vehicles, self._owned, self._leads = newest, vehicles, owned, leads
        self._unix_s, self._unix_minus_loop_s = unix_s, unix_minus_loop_s
        self.senders = [CotSender(each) for each in (config.tak.to if config.tak else ())]
        self._at_once = max(AT_ONCE, ceil(len(vehicles) / config.tick_rate_hz))
        self._waiting = np.zeros(0, np.intp)  # rows that are yet to be sent in this second
        self._next_s = -inf

    async def receive(self) -> None:
        """Keep connections open; what servers send is dropped."""
        async with asyncio.TaskGroup() as group:
            for sender in self.senders:
                group.create_task(sender.keep_open(), name=f"tak/{sender.at}")

    def send(self) -> None:
        now_s, due = self._newest.state.time_s, list[OwnTrack]()
        if not len(self._waiting):
            if now_s < self._next_s or self._why_none():
                return
            self._next_s = max(self._next_s, now_s - 0.5 * EVERY_S) + EVERY_S
            self._waiting = np.arange(len(self._vehicles))
            due += self._of_center()
        rows, self._waiting = self._waiting[: self._at_once], self._waiting[self._at_once :]
        due += self._of_vehicles(rows[self._believed()[rows]])
        unix_s = self._unix_s()
        events = [event(track, unix_s) for track in due]
        for sender in self.senders:
            sender.offer(events, now_s)

    def _why_none(self) -> str:
        """Why nothing may be sent, in words; empty: it may."""
        if self._settings is None:
            return "no receiver is configured"
        return NO_CLOCK if self._settings.require_clock and isnan(self._unix_minus_loop_s()) else ""

    def _believed(self) -> Mask:
        """(n,) the vehicles that this station flies, and of which the place is known now."""
        fleet = self._newest.state
        recent = (fleet.age_s <= self._age_max_s) & ~self._newest.silent & ~fleet.doubtful
        return np.asarray(self._owned() & recent & np.isfinite(fleet.position_m).all(axis=1))

    def _of_vehicles(self, rows: NDArray[np.intp]) -> Iterator[OwnTrack]:
        fleet, telemetry = self._newest.state, self._newest.telemetry
        moving = self._tracks(fleet.position_m[rows], fleet.velocity_m_s[rows])
        for row, track in zip(rows.tolist(), moving, strict=True):
            vehicle = self._vehicles.rows[row]
            yield track._replace(
                uid=f"{track.uid}.{vehicle.id}",
                callsign=f"{track.callsign} {vehicle.id}",
                remarks=f"{vehicle.phase.value}, {track.remarks}",
                deviation_m=float(telemetry.horizontal_accuracy_m[row]),
                height_deviation_m=float(telemetry.vertical_accuracy_m[row]),
                battery=float(telemetry.battery_remaining[row]),
            )

    def _of_center(self) -> Iterator[OwnTrack]:
        center = self._newest.memory.center
        if center is not None and self._leads():
            for track in self._tracks(center.position_m[None], center.velocity_m_s[None]):
                about = f"centre of the formation, no vehicle, {track.remarks}"
                yield track._replace(how=FUSED, remarks=about)

    def _tracks(self, position_m: Array, velocity_m_s: Array) -> Iterator[OwnTrack]:
        """Of (m, 3) places and velocities in the show frame, with the names of the centre."""
        if self._settings is None or not len(position_m):
            return
        geoid_m = nan if self._settings.geoid_m is None else self._settings.geoid_m
        columns = *self._frame.geodetic(position_m), *self._frame.into_ned(velocity_m_s).T[:2]
        for latitude_deg, longitude_deg, amsl_m, *moves_m_s in zip(
            *(column.tolist() for column in columns), strict=True
        ):
            place = latitude_deg, longitude_deg, amsl_m + geoid_m
            yield OwnTrack(
                self._uid, self._settings.callsign, MEASURED, *place, f"{amsl_m:.0f} m AMSL", *moves_m_s
            )

    def conditions(self, at: Instant) -> Iterator[Condition]:
        for receiver in self._receivers(at.time_s):
            if receiver.problem:
                yield Condition(AlarmCause.TAK_NOT_SENT, receiver.problem, about=receiver.at)

    def view(self, at: Instant) -> TakView | None:
        if self._settings is None:
            return None
        believed, owned = self._believed(), self._owned()
        missing = [self._vehicles.rows[row].id for row in np.flatnonzero(owned & ~believed).tolist()]
        more = f" and {len(missing) - SHOWN_MAX} more" if len(missing) > SHOWN_MAX else ""
        return TakView(
            callsign=self._settings.callsign,
            vehicles=float(believed.sum()),
            missing=", ".join(missing[:SHOWN_MAX]) + more,
            sent=sum(sender.sent for sender in self.senders),
            dropped=sum(sender.dropped for sender in self.senders),
            receivers=tuple(self._receivers(at.time_s)),
        )

    def _receivers(self, now_s: float) -> Iterator[TakReceiverView]:
        for sender in self.senders:
            why = self._why_none() or sender.problem(now_s)
            yield TakReceiverView(sender.at, why, sender.sent, sender.dropped)
