"""Reads the vehicles' parameters while they are on the ground, and reports what is wrong with them.

Reading runs beside the tick: it takes up to seconds, and a vehicle that does not answer delays no other.
"""

import asyncio
import logging
import math
from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np

from gcs.flight.fleet import Fleet
from gcs.flight.vehicle import Vehicle
from gcs.links import ParameterValue
from gcs.links.batch_link import Link
from gcs.model.errors import CommandError
from gcs.model.preflight_report import Check
from gcs.model.state import Mask, Telemetry, VehicleId
from gcs.preflight.parameters import parameter_checks, remaining_risks, requirements_of
from gcs.preflight.requirement import Requirement

log = logging.getLogger(__name__)

RETRY_S: Final = 2.0
"""Wait after a vehicle has not answered."""

AT_ONCE_MAX: Final = 50
"""Vehicles read at the same time: a thousand at once would delay the tick."""


async def read_needed(
    link: Link, vehicle_id: VehicleId, needed: Iterable[Requirement]
) -> dict[str, ParameterValue]:
    """Return the values of the required parameters; of alternatives the first that the vehicle has.

    Raises: CommandError naming a parameter that it must have.
    """
    values: dict[str, ParameterValue] = {}
    due = list(needed)
    while due:
        names, may_lack = [each.name for each in due], {each.name for each in due if each.may_lack}
        values |= await link.read_parameters(vehicle_id, names, may_lack)
        due = [each.otherwise for each in due if each.otherwise is not None and each.name not in values]
    return values


class ParameterReader:
    """Keeps `Fleet.parameters` current: reads on first contact, after a reboot, and after every flight."""

    def __init__(self, group: asyncio.TaskGroup, flight: Fleet) -> None:
        n = len(flight.vehicles)
        self._group = group
        self._flight = flight
        self._required = requirements_of(flight.config)
        # by vehicle and name, alternatives included
        self._needed = {
            name: {each.name: each for requirement in needed for each in requirement.alternatives}
            for name, needed in self._required.items()
        }
        for link in flight.links:
            link.watch_parameters({name for vehicle_id in link.ids for name in self._needed[vehicle_id]})
        self._reported: tuple[object, object] = None, None
        self._reported_columns = np.full(n, -1), np.zeros(n, dtype=bool)  # the same as arrays
        self._reboot_count = np.full(n, -1)
        self._absent: Mask = np.zeros(n, dtype=bool)
        self._due: Mask = np.zeros(n, dtype=bool)  # to be read (again), as soon as they are on the ground
        self._reading: Mask = np.zeros(n, dtype=bool)
        self._outdated: Mask = np.zeros(n, dtype=bool)  # what is being read may have changed meanwhile
        self._not_before_s = np.full(n, -np.inf)
        self._announced: dict[VehicleId, dict[str, ParameterValue]] = {}
        """Newest values since the vehicle's newest read began; the read may be older than they are."""

    def watch(self, received: Telemetry) -> None:
        """Start the reads that are due; called once a tick."""
        flight = self._flight
        if not flight.config.operation.require_parameters:
            return
        self._take_announced(received)
        now_s, absent = flight.fleet.time_s, ~flight.has_heartbeat
        if received.reboot_count is not self._reported[0] or received.armed is not self._reported[1]:
            self._reported = received.reboot_count, received.armed  # seldom other objects
            self._reported_columns = np.array(received.reboot_count), np.array(received.armed)
        reboot_count, armed = self._reported_columns
        for row in np.flatnonzero((absent & ~self._absent) | (reboot_count != self._reboot_count)).tolist():
            self._forget(flight.at_row(row))
        self._reboot_count, self._absent = reboot_count, absent
        self._due |= armed  # others may change parameters during a flight
        self._outdated |= armed
        waits = self._reading | armed | absent | (now_s < self._not_before_s)
        room = AT_ONCE_MAX - int(self._reading.sum())
        for row in np.flatnonzero(self._due & ~waits)[: max(room, 0)].tolist():
            self._begin(flight.at_row(row))

    def _take_announced(self, received: Telemetry) -> None:
        """Compare announced parameters with what preflight requires, whichever station set them."""
        for link in self._flight.links:
            for vehicle_id, values in link.reported_parameters().items():
                vehicle = self._flight.vehicles[vehicle_id]
                self._announced.setdefault(vehicle_id, {}).update(values)
                for name, value in values.items():
                    needed = self._needed[vehicle_id].get(name)
                    if needed is not None:
                        self._compare(vehicle, needed, value, armed=received.armed[vehicle.row])

    def _compare(
        self, vehicle: Vehicle, requirement: Requirement, value: ParameterValue, *, armed: bool
    ) -> None:
        """Store a value that another station has set; warn if it breaks what preflight requires."""
        flight, name = self._flight, requirement.name
        known = flight.parameters.get(vehicle.id)
        before = None if known is None else known.get(name)
        if before == value or (known is None and not armed):  # on the ground all of them are being read
            return
        if known is not None:
            flight.note_parameters(vehicle, {**known, name: value})
        if requirement.holds(value):
            self._settle(vehicle, {name: value})
            return
        was = "" if before is None else f" from {before:g}"
        where = "in flight" if armed else "on the ground"
        needed = f"{requirement.desired} is needed ({requirement.why})"
        text = f"{name} was changed{was} to {value:g} {where}, {needed}"
        flight.changed_parameters.setdefault(vehicle.id, {})[name] = text
        log.warning("parameter_changed", extra={"vehicle": vehicle.id, "reason": text})

    def _settle(self, vehicle: Vehicle, values: Mapping[str, ParameterValue]) -> None:
        changed, needed = self._flight.changed_parameters.get(vehicle.id, {}), self._needed[vehicle.id]
        for name in [name for name in changed if needed[name].holds(values.get(name, math.nan))]:
            del changed[name]
            log.info("parameter_right_again", extra={"vehicle": vehicle.id, "reason": name})
        if not changed:
            self._flight.changed_parameters.pop(vehicle.id, None)

    def checks(self, vehicle_id: VehicleId) -> list[Check]:
        """Return the checks of its parameters. If any fails they are read again: it may be fixed by then."""
        flight, needed = self._flight, self._required[vehicle_id]
        read, problem = flight.parameters.get(vehicle_id), flight.parameter_problems.get(vehicle_id)
        found = parameter_checks(needed, read, problem)
        if not all(check.passes for check in found):
            self._due[flight.vehicles[vehicle_id].row] = True
        return found

    def risks(self) -> list[str]:
        """Return what remains unsafe on the versions of some autopilots, with the vehicles, in words."""
        found: dict[str, list[VehicleId]] = {}
        for vehicle_id, needed in self._required.items():
            read = self._flight.parameters.get(vehicle_id)
            for text in [] if read is None else remaining_risks(needed, read):
                found.setdefault(text, []).append(vehicle_id)
        return [f"{', '.join(names)}: {text}" for text, names in found.items()]

    def _forget(self, vehicle: Vehicle) -> None:
        self._flight.parameters.pop(vehicle.id, None)
        self._flight.parameter_problems.pop(vehicle.id, None)
        self._not_before_s[vehicle.row] = -np.inf
        self._due[vehicle.row] = self._outdated[vehicle.row] = True

    def _begin(self, vehicle: Vehicle) -> None:
        self._due[vehicle.row] = self._outdated[vehicle.row] = False
        self._reading[vehicle.row] = True
        self._announced[vehicle.id] = {}
        self._group.create_task(self._read(vehicle), name=f"parameters/{vehicle.id}")

    async def _read(self, vehicle: Vehicle) -> None:
        flight, row = self._flight, vehicle.row
        try:
            read = await read_needed(flight.link_of[vehicle.id], vehicle.id, self._required[vehicle.id])
        except CommandError as error:
            flight.parameter_problems[vehicle.id] = str(error)
            self._not_before_s[row] = flight.fleet.time_s + RETRY_S
            self._due[row] = True
        else:
            if not self._outdated[row]:  # it has not restarted, flown or been silent meanwhile
                values = {**read, **self._announced[vehicle.id]}  # what was set after it had been read
                flight.note_parameters(vehicle, values)
                self._settle(vehicle, values)
                flight.parameter_problems.pop(vehicle.id, None)
                log.info("parameters_read", extra={"vehicle": vehicle.id})
        finally:
            self._reading[row] = False
