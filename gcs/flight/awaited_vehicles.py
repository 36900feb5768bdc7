"""Vehicles that the newest fleet-wide command has not reached yet.

Either they have sent nothing yet, or a stall before the command took them out of control after it was given.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Final

from gcs.flight.fleet import Fleet
from gcs.flight.maneuvers import Maneuvers
from gcs.flight.vehicle import Vehicle
from gcs.model.lifecycle import Phase
from gcs.model.state import VehicleId
from gcs.service import Outcome

RECEIVED_WITHIN_S: Final = 3.0
"""A command for an interrupted flight waits this long for vehicles that have sent nothing yet."""

REPLACED: Final = "replaced by another command"

Reached = Callable[[Vehicle], None]
Missed = Callable[[Vehicle, Outcome, str], None]


@dataclass(frozen=True, slots=True, eq=False)
class _Command:
    """The newest fleet-wide command, and the vehicles that it has not reached."""

    given_s: float
    reaches_fallen: bool
    vehicles: dict[VehicleId, Vehicle]
    reached: Reached
    missed: Missed


class AwaitedVehicles:
    """Keeps the awaited vehicles of the newest command. Changed on the event loop only."""

    def __init__(self, flight: Fleet, maneuvers: Maneuvers, now_s: Callable[[], float]) -> None:
        """`now_s` is the loop's clock: the newest tick may precede a stall."""
        self._flight = flight
        self._maneuvers = maneuvers
        self._now_s = now_s
        self._command: _Command | None = None

    @property
    def any(self) -> bool:
        """Whether a vehicle is awaited."""
        return self._command is not None and bool(self._command.vehicles)

    def expect(
        self, vehicles: Sequence[Vehicle], reached: Reached, missed: Missed, *, reaches_fallen: bool
    ) -> None:
        """Await `vehicles` for a command; replaces those that an earlier command awaits.

        Args:
            vehicles: have sent nothing yet.
            reached: called for each vehicle that the command may take control of.
            missed: called once for each other vehicle, with the outcome and the reason.
            reaches_fallen: whether `reached` is also called for vehicles that a stall takes out of control.
        """
        self.replace()
        awaited = {vehicle.id: vehicle for vehicle in vehicles}
        self._command = _Command(self._now_s(), reaches_fallen, awaited, reached, missed)

    def replace(self) -> None:
        """Forget the awaited vehicles: another command has replaced the one they wait for."""
        command, self._command = self._command, None
        if command is not None:
            for vehicle in command.vehicles.values():
                command.missed(vehicle, Outcome.FAILED, REPLACED)

    def falls(self, vehicle: Vehicle, since_s: float) -> bool:
        """Note that a stall took a vehicle out of control. Returns: whether the newest command reaches it.

        Args:
            vehicle: out of control now.
            since_s: commands given before this time do not reach it; the operator did not know of the stall.
        """
        command = self._command
        if command is None or not command.reaches_fallen or command.given_s < since_s:
            return False
        command.vehicles[vehicle.id] = vehicle
        return True

    def receive(self, waiting: Collection[VehicleId], why_not: Callable[[Vehicle], str]) -> None:
        """Pass on the vehicles that have sent telemetry by now; report those whose time is over as missed.

        Args:
            waiting: vehicles that the command may take control of.
            why_not: returns why the command may not take control of a vehicle.
        """
        command = self._command
        if command is None:
            return
        late = self._flight.fleet.time_s > command.given_s + RECEIVED_WITHIN_S
        for vehicle in list(command.vehicles.values()):
            if vehicle.phase is Phase.OFFLINE and not late:
                continue
            del command.vehicles[vehicle.id]
            if vehicle.phase is Phase.OFFLINE:
                why = f"not received within {RECEIVED_WITHIN_S:g} s of the command"
                command.missed(vehicle, Outcome.FAILED, why)
            elif self._maneuvers.running(vehicle):
                command.missed(vehicle, Outcome.FAILED, REPLACED)
            elif vehicle.id in waiting:
                command.reached(vehicle)
            else:
                command.missed(vehicle, Outcome.NOT_INCLUDED, why_not(vehicle))
