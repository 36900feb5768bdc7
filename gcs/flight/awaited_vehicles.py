"""Vehicles that the newest command to all still has to reach.

Nothing was received of them yet, or the stall before the command took them out of control after it.
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
"""A command for an interrupted flight awaits vehicles of which nothing was received yet for so long."""

REPLACED: Final = "replaced by another command"

Reached = Callable[[Vehicle], None]
Missed = Callable[[Vehicle, Outcome, str], None]


@dataclass(frozen=True, slots=True, eq=False)
class _Command:
    """The newest command to all, and the vehicles that it has not reached."""

    given_s: float
    reaches_fallen: bool
    vehicles: dict[VehicleId, Vehicle]
    reached: Reached
    missed: Missed


class AwaitedVehicles:
    """Changed only on the event loop."""

    def __init__(self, flight: Fleet, maneuvers: Maneuvers, now_s: Callable[[], float]) -> None:
        """`now_s` is the loop's clock: the newest tick may have been before a stall."""
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
        """Await `vehicles` for a command, instead of those that an earlier command awaits.

        Args:
            vehicles: of which nothing was received yet.
            reached: called for each vehicle that the command may take control of.
            missed: called once for each other, with the outcome and the reason.
            reaches_fallen: whether `reached` is also for vehicles that a stall takes out of control now.
        """
        self.replace()
        awaited = {vehicle.id: vehicle for vehicle in vehicles}
        self._command = _Command(self._now_s(), reaches_fallen, awaited, reached, missed)

    def replace(self) -> None:
        """Another command has come: nothing is awaited any more."""
        command, self._command = self._command, None
        if command is not None:
            for vehicle in command.vehicles.values():
                command.missed(vehicle, Outcome.FAILED, REPLACED)

    def falls(self, vehicle: Vehicle, since_s: float) -> bool:
        """A stall has taken a vehicle out of control. Returns: whether the newest command is for it as well.

        Args:
            vehicle: out of control now.
            since_s: commands given before that do not reach it: an operator knew nothing of the stall.
        """
        command = self._command
        if command is None or not command.reaches_fallen or command.given_s < since_s:
            return False
        command.vehicles[vehicle.id] = vehicle
        return True

    def receive(self, waiting: Collection[VehicleId], why_not: Callable[[Vehicle], str]) -> None:
        """Hand on the vehicles that were received meanwhile; name those that were not received in time.

        Args:
            waiting: vehicles that the command may take control of.
            why_not: why it may not.
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
