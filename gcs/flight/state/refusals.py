"""Why this station does not take control of a vehicle, and what is accepted instead of a refused command."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from typing import Concatenate, Final, ParamSpec, Protocol, TypeVar

from gcs.config.sections import OperationSettings
from gcs.estimation.link_health import BEATS_MAY_LACK_S
from gcs.failsafe.autopilot_failsafe import FailsafeInputs, comes_down, control_refusal
from gcs.flight.state.newest import Newest
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import NEXT, Event, Phase
from gcs.model.state import Mode, VehicleId, Whereabouts
from gcs.service import ShowAction, VehicleAction

P = ParamSpec("P")
R = TypeVar("R")
S = TypeVar("S", bound="_Refusing")

A_PERSON_FLIES = frozenset({Mode.POSITION, Mode.OTHER})
"""Modes that no autopilot chooses for itself while it has a position: a pilot is at the sticks."""

SAFER: Final = (
    (VehicleAction.TAKE_CONTROL, Event.TAKE_CONTROL),
    (VehicleAction.HOLD, Event.HOLD),
    (VehicleAction.LAND, Event.DESCEND),
)
"""Commands that shorten a vehicle's flight; the first that its phase allows is named."""

AIRBORNE: Final = frozenset({Whereabouts.CONTROLLED, Whereabouts.UNCONTROLLED})


@dataclass(frozen=True, eq=False)
class Refusals:
    """Why commands to the vehicles of one flight are refused."""

    newest: Newest
    vehicles: FlightVehicles
    operation: OperationSettings
    inputs: Callable[[Vehicle], FailsafeInputs]

    def why_never(self, vehicle: Vehicle) -> str:
        """Why not even a command that names the vehicle takes control of it; empty when one may."""
        return control_refusal(vehicle.id, self.inputs(vehicle))

    def why_not_unnamed(self, vehicle: Vehicle) -> str:
        """Why a command to all vehicles omits this one; a command that names it may reach it."""
        inputs = self.inputs(vehicle)
        if inputs.mode in A_PERSON_FLIES and not inputs.in_failsafe:
            agreed = f"take-control {vehicle.id} names it, when the pilot agrees"
            return f"a pilot flies it, in mode {inputs.mode}: {agreed}"
        return self.why_never(vehicle) or self.why_not_without_heartbeat(vehicle)

    def why_not_without_heartbeat(self, vehicle: Vehicle) -> str:
        """Why a command to all vehicles omits one whose mode is out of date; empty while it is not.

        Its positions may still arrive after a pilot has taken over.
        """
        age_s = self.newest.state.time_s - float(self.newest.telemetry.heartbeat_time_s[vehicle.row])
        if age_s <= self.operation.silence_s + BEATS_MAY_LACK_S:
            return ""
        agreed = f"take-control {vehicle.id} names it, when its pilot agrees"
        return f"no heartbeat for {age_s:.1f} s, a pilot may have it: {agreed}"

    def why_not_touching_down(self, vehicle: Vehicle) -> str:
        """Why a command to all omits a vehicle whose autopilot is about to touch down; empty for others."""
        inputs = self.inputs(vehicle)
        ground_z_m = 0.0 if vehicle.home_m is None else float(vehicle.home_m[2])
        height_m = ground_z_m - float(self.newest.position_m(vehicle)[2])
        if not comes_down(inputs) or not height_m < self.operation.handover_height_m:
            return ""
        return (
            f"its autopilot lands it, {max(height_m, 0.0):.1f} m above the ground: it is left to touch down"
        )

    @contextmanager
    def instead(self, vehicle_id: VehicleId | None = None) -> Iterator[None]:
        """Add to a refusal raised inside a safer command that is accepted now; none if nothing is airborne.

        Raises: RefusedError, as raised inside, with that command in its text.
        """
        try:
            yield
        except RefusedError as error:
            named = self._accepted(vehicle_id)
            if not named:
                raise
            raise RefusedError(f"{str(error).rstrip('.')}; accepted instead: {named}") from None

    def _accepted(self, vehicle_id: VehicleId | None) -> str:
        """Return the command in the syntax of `gcs`; empty when nothing is airborne."""
        vehicles = self.vehicles
        if not any(self.newest.whereabouts(vehicle) in AIRBORNE for vehicle in vehicles.values()):
            return ""
        vehicle = None if vehicle_id is None else vehicles.get(vehicle_id)
        if (
            vehicle is not None
            and vehicle.phase not in {Phase.LOST, Phase.STANDBY}
            and not vehicle.flags.handed_over
        ):
            for action, event in SAFER:
                never = action is VehicleAction.TAKE_CONTROL and self.why_never(vehicle)
                if (vehicle.phase, event) in NEXT and not never:
                    return f"{action} {vehicle.id}"
        return ShowAction.STOP.value


class _Refusing(Protocol):
    refusals: Refusals


def with_alternative(command: Callable[Concatenate[S, P], R]) -> Callable[Concatenate[S, P], R]:
    """Decorate a command method: see `Refusals.instead`."""

    @wraps(command)
    def wrapped(self: S, /, *args: P.args, **kwargs: P.kwargs) -> R:
        with self.refusals.instead():
            return command(self, *args, **kwargs)

    return wrapped
