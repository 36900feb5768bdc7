"""A recorded flight as a service: its states come as if live, and nothing can be ordered."""

import asyncio
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from math import isfinite, nan
from pathlib import Path
from typing import Any, Final, NoReturn

import numpy as np

from gcs.bounds import bounds
from gcs.checks import PreflightReport
from gcs.errors import GcsError, RefusedError, UnknownError
from gcs.frames import ShowFrame
from gcs.happenings import Happening
from gcs.interrupted import Offer
from gcs.lifecycle import ShowPhase, not_ours
from gcs.plan import Formation, Obstacle, Orbit, Target, Yaw
from gcs.records import layout
from gcs.records.certify import Standard
from gcs.records.flown import FlightData, Flown
from gcs.records.plans import plan_of
from gcs.rows import VehicleRows
from gcs.service import (
    Audit,
    FleetView,
    Histogram,
    Latest,
    NoAudit,
    OrderRecord,
    SelectedShow,
    ShowAction,
    ShowCheck,
    Shows,
    StoredShow,
    TickView,
    VehicleAction,
)
from gcs.state import Array, Landed, VehicleId

REPEAT_S: Final = 0.5
"""The last state is shown again that often, so that a viewer knows that somebody is there."""

NOTHING_COUNTED: Final = Histogram((), (0,), 0.0)
"""What is counted for metrics is not recorded."""

Triple = tuple[float, float, float]


class NoShows:
    """The show files of a replay: none, and none are taken. A `gcs.service.Shows`."""

    def __init__(self, path: Path) -> None:
        """`path` of the record."""
        self._why = f"this is a replay of {path}: it keeps no shows"

    async def listed(self) -> list[StoredShow]:
        """None."""
        return []

    async def text(self, _name: str) -> str:
        """Refused."""
        raise RefusedError(self._why)

    async def store(self, _name: str, _text: bytes) -> StoredShow:
        """Refused."""
        raise RefusedError(self._why)

    async def remove(self, _name: str) -> None:
        """Refused."""
        raise RefusedError(self._why)

    def check(self, _name: str) -> ShowCheck:
        """Refused."""
        raise RefusedError(self._why)

    def checked(self, name: str) -> ShowCheck:
        """Raises: UnknownError."""
        raise UnknownError(f"{name} was never checked here: {self._why}")


class Replay:
    """A `gcs.service.Service` over a recorded flight. Must be made on the running event loop."""

    def __init__(self, data: FlightData, speed: float) -> None:
        """Raises: GcsError when the record has no tick, or its configuration no show frame."""
        self._data = data
        self._speed = speed
        self._audit = NoAudit()
        self._shows = NoShows(data.path)
        try:
            self._frame = ShowFrame(**data.about.config["show_frame"])
        except (KeyError, TypeError, GcsError) as error:
            raise GcsError(f"{data.path}: its configuration has no show frame: {error}") from None
        self._bounds = bounds(Standard.of(data.about.config, str(data.path)).safety)
        self._ticks: Iterator[Flown] = data.ticks()
        first = next(self._ticks, None)
        if first is None:
            raise GcsError(f"{data.path}: there is no flight in it. {data.cut}".strip())
        self._first = first
        self._view = Latest(self._state(first, alive=True))

    async def run(self) -> None:
        """Show every state in its time, then the last one, until cancelled."""
        loop = asyncio.get_running_loop()
        began_s, flown = loop.time(), self._first
        for flown in self._ticks:
            due_s = began_s + (flown.unix_s - self._first.unix_s) / self._speed
            if due_s > loop.time():
                await asyncio.sleep(due_s - loop.time())
            elif flown.tick["timing"]["count"] % 20:
                continue  # too fast to show every one
            self._view.set(self._state(flown, alive=True))
        while True:
            self._view.set(self._state(flown, alive=False))
            await asyncio.sleep(REPEAT_S)

    def _state(self, flown: Flown, *, alive: bool) -> FleetView:
        tick, status = flown.tick, flown.status
        selected, start_unix_s = status["selected"], status["start_unix_time_s"]
        now_s = asyncio.get_running_loop().time()
        rows = self._rows(flown)
        problems: Sequence[str] = status["problems"]
        timing: dict[str, Any] = {
            name: nan if value is None else value for name, value in tick["timing"].items()
        }
        return FleetView(
            time_s=now_s,
            unix_time_s=flown.unix_s,
            show=ShowPhase(status["show"]),
            reason=status["reason"],
            rows=rows,
            plan=plan_of(status["plan"], now_s - tick["time_s"]),
            bounds=self._bounds,
            center_m=_triple(tick["center_m"]),
            center_velocity_m_s=_triple(tick["center_velocity_m_s"]),
            radius_m=tick["radius_m"],
            target_m=(tick["target_m"][0], tick["target_m"][1]),
            minimum_separation_m=tick["minimum_separation_m"],
            tick=TickView(**timing, durations=NOTHING_COUNTED, latenesses=NOTHING_COUNTED),
            control_alive=alive and tick["control_alive"],
            setpoints_sent=tick["setpoints_sent"],
            interventions=0,
            notices=(
                self._notice(flown, alive=alive),
                *not_ours(zip(rows.ids, rows.phases, strict=True)),
                *problems,
            ),
            selected=None
            if selected is None
            else SelectedShow(
                **{
                    **selected,
                    "cues": tuple(selected["cues"]),
                    "timeline": tuple((cue, at_s) for cue, at_s in selected.get("timeline", ())),
                }
            ),
            start_unix_time_s=start_unix_s,
            countdown_s=None if start_unix_s is None else max(0.0, start_unix_s - flown.unix_s),
        )

    def _notice(self, flown: Flown, *, alive: bool) -> str:
        when = datetime.fromtimestamp(flown.unix_s, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
        told = f"replay of {self._data.path} at {self._speed:g} times its speed: {when}; nothing here flies"
        return told if alive else f"{told}; the record has ended. {self._data.cut}".strip()

    def _rows(self, flown: Flown) -> VehicleRows:
        about, table, n = self._data.about, flown.vehicles, len(flown.vehicles)
        position_m = layout.positions_m(table)
        latitude_deg, longitude_deg, altitude_m = self._frame.geodetic(position_m)
        restrained_by: dict[str, str] = flown.tick["restrained_by"]

        def column(name: str) -> Array:
            return table[name].astype(np.float64)

        return VehicleRows(
            ids=about.ids,
            system_ids=about.system_ids,
            links=about.links,
            phases=[about.phases[number] for number in table["phase"].tolist()],
            reasons=flown.status["reasons"],
            modes=[about.modes[number] for number in table["mode"].tolist()],
            armed=table["armed"].astype(np.bool_).tolist(),
            landed=[Landed(number) for number in table["landed"].tolist()],
            ready=table["ready"].astype(np.bool_).tolist(),
            position_m=position_m,
            velocity_m_s=layout.velocities_m_s(table),
            setpoint_m_s=layout.setpoints_m_s(table),
            yaw_rad=column("yaw_rad"),
            latitude_deg=latitude_deg,
            longitude_deg=longitude_deg,
            altitude_amsl_m=altitude_m,
            battery_remaining=column("battery_remaining"),
            position_age_s=column("position_age_s"),
            uncertainty_m=column("position_uncertainty_m"),
            heartbeat_age_s=column("heartbeat_age_s"),
            link_quality=np.full(n, np.nan),
            fix_type=np.full(n, np.nan),
            restrained_by=[restrained_by.get(name, "") for name in about.ids],
            colour=np.zeros((n, 3), np.uint8),
            lit=np.zeros(n, np.bool_),
            homes_m=[None] * n,
        )

    @property
    def view(self) -> Latest[FleetView]:
        """The state that is shown now."""
        return self._view

    @property
    def frame(self) -> ShowFrame:
        """Where the show's origin lay."""
        return self._frame

    @property
    def audit(self) -> Audit:
        """Nothing is recorded of a replay."""
        return self._audit

    def orders(self) -> Sequence[OrderRecord]:
        """None: they stand in the audit beside the flight data."""
        return ()

    def _refuse(self) -> NoReturn:
        raise RefusedError(f"this is a replay of {self._data.path}: nothing can be ordered or changed")

    @property
    def shows(self) -> Shows:
        """None."""
        return self._shows

    def happenings(self) -> Sequence[Happening]:
        """None yet."""
        return ()

    def command_show(
        self,
        _action: ShowAction,
        _vehicles: Sequence[VehicleId] | None = None,
        *,
        show_hash: str | None = None,  # noqa: ARG002 (callers name it)
        at_unix_time_s: float | None = None,  # noqa: ARG002
    ) -> OrderRecord:
        """Refused."""
        self._refuse()

    def select_show(self, _name: str, _show_hash: str) -> SelectedShow:
        """Refused."""
        self._refuse()

    def deselect_show(self) -> None:
        """Refused."""
        self._refuse()

    def seek_show(self, _cue: str) -> SelectedShow:
        """Refused."""
        self._refuse()

    def preflight(self, _vehicles: Sequence[VehicleId] | None = None) -> PreflightReport:
        """Refused."""
        self._refuse()

    def exclude(self, _vehicle_id: VehicleId, _reason: str) -> OrderRecord:
        """Refused."""
        self._refuse()

    def include(self, _vehicle_id: VehicleId) -> OrderRecord:
        """Refused."""
        self._refuse()

    def command_vehicle(self, _vehicle_id: VehicleId, _action: VehicleAction) -> OrderRecord:
        """Refused."""
        self._refuse()

    def kill(self, _vehicle_ids: Sequence[VehicleId]) -> OrderRecord:
        """Refused."""
        self._refuse()

    def settle(self, _offer: Offer) -> OrderRecord:
        """Refused."""
        self._refuse()

    def order(self, order_id: str) -> OrderRecord:
        """Raises: UnknownError; orders are in the audit."""
        raise UnknownError(f"there is no order {order_id}: this is a replay; past orders are in the audit")

    def set_formation(self, _formation: Formation) -> None:
        """Refused."""
        self._refuse()

    def set_orbit(self, _orbit: Orbit) -> None:
        """Refused."""
        self._refuse()

    def set_target(self, _target: Target) -> None:
        """Refused."""
        self._refuse()

    def set_yaw(self, _yaw: Yaw) -> None:
        """Refused."""
        self._refuse()

    def add_obstacle(self, _obstacle: Obstacle) -> None:
        """Refused."""
        self._refuse()

    def change_obstacle(self, _obstacle: Obstacle) -> None:
        """Refused."""
        self._refuse()

    def remove_obstacle(self, _obstacle_id: str) -> None:
        """Refused."""
        self._refuse()


def _triple(values: Sequence[float] | None) -> Triple | None:
    """None for what was not known."""
    if values is None or not isfinite(values[0]):
        return None
    return values[0], values[1], values[2]
