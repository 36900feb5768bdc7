"""Chooses the vehicles that fly: those on the ground that are not excluded."""

import logging
from collections.abc import Callable, Sequence

from gcs.flight.command_log import CommandLog
from gcs.flight.fleet import Fleet
from gcs.model.errors import InvalidError, RefusedError
from gcs.model.lifecycle import GROUNDED, ON_THE_GROUND, Phase
from gcs.model.preflight_report import Exclusion
from gcs.model.state import VehicleId
from gcs.service import CALLER, CommandRecord, Outcome

log = logging.getLogger(__name__)

REASON_MAX = 200


class Participants:
    """Chooses the vehicles of a start, and lets an operator exclude vehicles."""

    def __init__(self, flight: Fleet, book: CommandLog, unix_s: Callable[[], float]) -> None:
        self._flight = flight
        self._book = book
        self._unix_s = unix_s

    def choose(self, desired: Sequence[VehicleId] | None) -> tuple[list[VehicleId], dict[VehicleId, str]]:
        """Return the vehicles that fly, and why the others do not. Raises: UnknownError, RefusedError."""
        flight = self._flight
        for name in desired or ():
            flight.vehicle(name)
        chosen, left_out = self.could(desired)
        meant = set(flight.vehicles if desired is None else desired) - set(chosen)
        for name, vehicle in flight.vehicles.items():
            if name not in meant:
                continue
            exclusion = flight.excluded.get(name)
            if exclusion is not None and desired is not None:
                raise RefusedError(f"{name} was {exclusion}; include it first")
            if exclusion is None and (desired is not None or vehicle.phase is not Phase.OFFLINE):
                raise RefusedError(
                    f"{name} is {vehicle.phase}: {vehicle.reason.removesuffix('.')}; only standby can start"
                )
        if not chosen:
            raise RefusedError("no vehicle is online")
        return chosen, left_out

    def could(self, desired: Sequence[VehicleId] | None) -> tuple[list[VehicleId], dict[VehicleId, str]]:
        """Return the desired vehicles that could fly, and why the others do not; raises nothing."""
        chosen: list[VehicleId] = []
        left_out: dict[VehicleId, str] = {}
        meant = None if desired is None else frozenset(desired)
        for name, vehicle in self._flight.vehicles.items():
            if name in self._flight.excluded:
                left_out[name] = str(self._flight.excluded[name])
            elif meant is not None and name not in meant:
                left_out[name] = "not chosen"
            elif vehicle.phase is Phase.STANDBY:
                chosen.append(name)
            else:
                left_out[name] = f"{vehicle.phase}: {vehicle.reason}"
        return chosen, left_out

    def exclude(self, vehicle_id: VehicleId, reason: str) -> CommandRecord:
        """Take a vehicle out of the show, until it is included again.

        Raises: UnknownError, InvalidError; RefusedError unless all vehicles are on the ground.
        """
        if len(reason) > REASON_MAX:
            raise InvalidError("reason", reason[:20], f"at most {REASON_MAX} characters")
        self._need_ground(vehicle_id)
        exclusion = Exclusion(CALLER.get(), reason, self._unix_s())
        self._flight.excluded[vehicle_id] = exclusion
        log.warning("excluded", extra={"vehicle": vehicle_id, "by": exclusion.by, "reason": reason})
        return self._noted("exclude", vehicle_id, str(exclusion))

    def include(self, vehicle_id: VehicleId) -> CommandRecord:
        """Include an excluded vehicle again.

        Raises: UnknownError; RefusedError if it is not excluded, or unless all vehicles are on the ground.
        """
        self._need_ground(vehicle_id)
        if self._flight.excluded.pop(vehicle_id, None) is None:
            raise RefusedError(f"{vehicle_id} was not taken out of the show")
        log.info("included", extra={"vehicle": vehicle_id, "by": CALLER.get()})
        return self._noted("include", vehicle_id, "")

    def _noted(self, action: str, vehicle_id: VehicleId, reason: str) -> CommandRecord:
        record = self._book.open(action, [vehicle_id], {})
        self._book.close(record.id, vehicle_id, Outcome.DONE, reason)
        return self._book.get(record.id)

    def _need_ground(self, vehicle_id: VehicleId) -> None:
        vehicle, flight = self._flight.vehicle(vehicle_id), self._flight
        if flight.show not in ON_THE_GROUND or flight.airborne:
            raise RefusedError(
                f"vehicles can be excluded or included only on the ground (the show is {flight.show})"
            )
        if vehicle.phase not in GROUNDED:
            because = vehicle.reason.removesuffix(".")
            raise RefusedError(f"{vehicle_id} is {vehicle.phase}: {because}; it is not on the ground")
