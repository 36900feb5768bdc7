"""The methods that a replay refuses: all commands and changes."""

from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from gcs.model.errors import RefusedError, UnknownError
from gcs.model.interrupted_flight import Offer
from gcs.model.plan import Formation, Obstacle, Orbit, Target, Yaw
from gcs.model.preflight_report import PreflightReport
from gcs.model.state import VehicleId
from gcs.service import (
    Audit,
    CommandRecord,
    NoAudit,
    SelectedShow,
    ShowAction,
    ShowCheck,
    Shows,
    StoredShow,
    VehicleAction,
)
from gcs.service.alarms import Alarm


class NoShows:
    """A replay has no show files and accepts none. Implements `gcs.service.Shows`."""

    def __init__(self, path: Path) -> None:
        """`path` of the record."""
        self._why = f"this is a replay of {path}: it keeps no shows"

    @property
    def why_not_kept(self) -> str:
        """Why no file can be stored: a replay never can."""
        return self._why

    async def list_shows(self) -> list[StoredShow]:
        return []

    async def text(self, _name: str) -> str:
        raise RefusedError(self._why)

    async def store(self, _name: str, _text: bytes) -> StoredShow:
        raise RefusedError(self._why)

    async def remove(self, _name: str) -> None:
        raise RefusedError(self._why)

    def check(self, _name: str) -> ShowCheck:
        raise RefusedError(self._why)

    def checked(self, name: str) -> ShowCheck:
        raise UnknownError(f"{name} was never checked here: {self._why}")


class ReadOnlyService:
    """The methods of `gcs.service.Service` that command and change: all are refused."""

    def __init__(self, path: Path) -> None:
        """`path` of the record."""
        self._path = path
        self._audit = NoAudit()
        self._shows = NoShows(path)

    def _refuse(self) -> NoReturn:
        raise RefusedError(f"this is a replay of {self._path}: nothing can be commanded or changed")

    @property
    def audit(self) -> Audit:
        """An audit that records nothing."""
        return self._audit

    @property
    def shows(self) -> Shows:
        """An empty library."""
        return self._shows

    def command_show(
        self,
        _action: ShowAction,
        _vehicles: Sequence[VehicleId] | None = None,
        *,
        show_hash: str | None = None,  # noqa: ARG002 (callers name it)
        at_unix_time_s: float | None = None,  # noqa: ARG002
    ) -> CommandRecord:
        self._refuse()

    def select_show(self, _name: str, _show_hash: str) -> SelectedShow:
        self._refuse()

    def deselect_show(self) -> None:
        self._refuse()

    def seek_show(self, _cue: str) -> SelectedShow:
        self._refuse()

    def preflight(self, _vehicles: Sequence[VehicleId] | None = None) -> PreflightReport:
        self._refuse()

    def exclude(self, _vehicle_id: VehicleId, _reason: str) -> CommandRecord:
        self._refuse()

    def include(self, _vehicle_id: VehicleId) -> CommandRecord:
        self._refuse()

    def command_vehicle(self, _vehicle_id: VehicleId, _action: VehicleAction) -> CommandRecord:
        self._refuse()

    def command_vehicles(
        self, _action: VehicleAction, _vehicles: Sequence[VehicleId] | None = None
    ) -> CommandRecord:
        self._refuse()

    def kill(self, _vehicle_ids: Sequence[VehicleId]) -> CommandRecord:
        self._refuse()

    def acknowledge_alarm(self, _alarm_id: str) -> Alarm:
        self._refuse()

    def acknowledge_alarms(self) -> Sequence[Alarm]:
        self._refuse()

    def settle(self, _offer: Offer) -> CommandRecord:
        self._refuse()

    def command_record(self, command_id: str) -> CommandRecord:
        """Raises: UnknownError; commands are in the audit."""
        raise UnknownError(
            f"there is no command {command_id}: this is a replay; past commands are in the audit"
        )

    def commands(self) -> Sequence[CommandRecord]:
        """Empty: commands are in the audit beside the flight data."""
        return ()

    def set_formation(self, _formation: Formation) -> None:
        self._refuse()

    def set_orbit(self, _orbit: Orbit) -> None:
        self._refuse()

    def set_target(self, _target: Target) -> None:
        self._refuse()

    def set_yaw(self, _yaw: Yaw) -> None:
        self._refuse()

    def add_obstacle(self, _obstacle: Obstacle) -> None:
        self._refuse()

    def change_obstacle(self, _obstacle: Obstacle) -> None:
        self._refuse()

    def remove_obstacle(self, _obstacle_id: str) -> None:
        self._refuse()
