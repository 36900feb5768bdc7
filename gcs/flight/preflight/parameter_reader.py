"""Reads the vehicles' parameters while they are on the ground, and reports what is wrong with them.

Reading runs beside the tick: it takes up to seconds, and a vehicle that does not answer delays no other.
"""

import asyncio
import logging
import math
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Final

import numpy as np

from gcs.config.schema import Config
from gcs.flight.state.newest import Newest
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.links import ParameterValue
from gcs.links.autopilots.versions import Version
from gcs.links.batch_link import Link
from gcs.model.errors import CommandError
from gcs.model.preflight_report import Check
from gcs.model.state import Mask, Telemetry, VehicleId
from gcs.preflight.parameters import FleetRequirements, parameter_checks, remaining_risks
from gcs.preflight.requirement import Requirement
from gcs.preflight.versions import missing_to_do, version_checks, version_risks

log = logging.getLogger(__name__)

RETRY_S: Final = 2.0
"""Wait after a vehicle has not answered."""

VERSION_S: Final = 2.0
"""Longest wait for a vehicle's version: it says which parameters there are. Without it their names tell."""

AT_ONCE_MAX: Final = 50
"""Vehicles read at the same time: a thousand at once would delay the tick."""


async def read_needed(
    link: Link, vehicle_id: VehicleId, needed: Iterable[Requirement]
) -> dict[str, ParameterValue]:
    """Return the values of the required parameters; of alternatives the first that the vehicle has.

    What it may lack takes seconds to be missed, so all of that is read at the same time.

    Raises: CommandError naming a parameter that it must have.
    """
    due = [each for each in needed if not each.is_absent]
    beside = [each.unless for each in due if each.unless]
    must = [*(each.name for each in due if not each.may_lack), *beside]

    async def one_of(requirement: Requirement) -> Mapping[str, ParameterValue]:
        for each in requirement.alternatives:
            may_lack: Collection[str] = (each.name,) if each.may_lack else ()
            if read := await link.read_parameters(vehicle_id, (each.name,), may_lack):
                return read
        return {}

    parts = await asyncio.gather(
        link.read_parameters(vehicle_id, must), *(one_of(each) for each in due if each.may_lack)
    )
    return {name: value for part in parts for name, value in part.items()}


class ParameterReader:
    """Keeps `Flight.parameters` current: reads on first contact, after a reboot, and after every flight."""

    def __init__(
        self,
        group: asyncio.TaskGroup,
        newest: Newest,
        vehicles: FlightVehicles,
        config: Config,
        link_of: Mapping[VehicleId, Link],
        parameters: dict[VehicleId, Mapping[str, ParameterValue]],
        changed: dict[VehicleId, dict[str, str]],
        note_parameters: Callable[[Vehicle, Mapping[str, ParameterValue]], None],
    ) -> None:
        """Reads as tasks of `group`; `note_parameters` takes what was read, as `parameters`, for the flight.

        `changed` receives what others have changed from what preflight requires.
        """
        n = len(vehicles)
        self._group = group
        self._newest, self._vehicles, self._config = newest, vehicles, config
        self._link_of, self._links = link_of, tuple(dict.fromkeys(link_of.values()))
        self._parameters, self._changed, self._note_parameters = parameters, changed, note_parameters
        self._problems: dict[VehicleId, str] = {}  # why they could not be read
        self._requirements = FleetRequirements(config)
        self._versions: dict[VehicleId, Version] = {}
        for link in self._links:
            link.watch_parameters({name for vehicle_id in link.ids for name in self._needed(vehicle_id)})
        self._reported: tuple[object, object, object] = None, None, None
        self._reported_columns = np.full(n, -1), np.zeros(n, dtype=bool)  # the same as arrays
        self._reboot_count = np.full(n, -1)
        self._absent: Mask = np.zeros(n, dtype=bool)
        self._due: Mask = np.zeros(n, dtype=bool)  # to be read (again), as soon as they are on the ground
        self._reading: Mask = np.zeros(n, dtype=bool)
        self._outdated: Mask = np.zeros(n, dtype=bool)  # what is being read may have changed meanwhile
        self._not_before_s = np.full(n, -np.inf)
        self._announced: dict[VehicleId, dict[str, ParameterValue]] = {}
        """Newest values since the vehicle's newest read began; the read may be older than they are."""

    def _required(self, vehicle_id: VehicleId) -> tuple[Requirement, ...]:
        return self._requirements.of(vehicle_id, self._versions.get(vehicle_id))

    def _needed(self, vehicle_id: VehicleId) -> Mapping[str, Requirement]:
        """What is required, by name, alternatives included."""
        return {
            each.name: each for requirement in self._required(vehicle_id) for each in requirement.alternatives
        }

    def watch(self, received: Telemetry) -> None:
        """Start the reads that are due; called once a tick."""
        if not self._config.operation.require_parameters:
            return
        self._take_announced(received)
        now_s, absent = self._newest.state.time_s, ~self._newest.has_heartbeat
        seldom = received.reboot_count, received.armed, received.version  # seldom other objects
        if any(now is not before for now, before in zip(seldom, self._reported, strict=True)):
            self._reported = seldom
            self._reported_columns = np.array(received.reboot_count), np.array(received.armed)
            self._note_versions(received)
        reboot_count, armed = self._reported_columns
        anew = (absent & ~self._absent) | (reboot_count != self._reboot_count)
        for row in anew.nonzero()[0].tolist():
            self._forget(self._vehicles.rows[row])
        self._reboot_count, self._absent = reboot_count, absent
        self._due |= armed  # others may change parameters during a flight
        self._outdated |= armed
        waits = self._reading | armed | absent | (now_s < self._not_before_s)
        room = AT_ONCE_MAX - np.count_nonzero(self._reading)
        for row in (self._due & ~waits).nonzero()[0][: max(room, 0)].tolist():
            self._begin(self._vehicles.rows[row])

    def _note_versions(self, received: Telemetry) -> None:
        """Read the parameters of vehicles that have another version than before: others may be required."""
        for vehicle in self._vehicles.values():
            version, before = Version.of(received.version[vehicle.row]), self._versions.get(vehicle.id)
            if version is None or version == before:
                continue
            self._versions[vehicle.id] = version
            self._forget(vehicle)
            if before is not None:
                title = vehicle.autopilot.versions.title
                text = f"{title} {version}, before it was {before}: its parameters are read again"
                log.warning("autopilot_version_changed", extra={"vehicle": vehicle.id, "reason": text})

    def _take_announced(self, received: Telemetry) -> None:
        """Compare announced parameters with what preflight requires, whichever station set them."""
        for link in self._links:
            for vehicle_id, values in link.reported_parameters().items():
                vehicle = self._vehicles[vehicle_id]
                self._announced.setdefault(vehicle_id, {}).update(values)
                for name, value in values.items():
                    needed = self._needed(vehicle_id).get(name)
                    if needed is not None:
                        self._compare(vehicle, needed, value, armed=received.armed[vehicle.row])

    def _compare(
        self, vehicle: Vehicle, requirement: Requirement, value: ParameterValue, *, armed: bool
    ) -> None:
        """Store a value that another station has set; warn if it breaks what preflight requires."""
        name = requirement.name
        read = self._parameters.get(vehicle.id)
        before = None if read is None else read.get(name)
        if before == value or (read is None and not armed):  # on the ground all of them are being read
            return
        if read is not None:
            self._note_parameters(vehicle, {**read, name: value})
        if requirement.risk or requirement.is_met({**(read or {}), name: value}):
            self._settle(vehicle, {name: value})
            return
        was = "" if before is None else f" from {before:g}"
        where = "in flight" if armed else "on the ground"
        needed = f"{requirement.desired} is needed ({requirement.why})"
        text = f"{name} was changed{was} to {value:g} {where}, {needed}"
        self._changed.setdefault(vehicle.id, {})[name] = text
        log.warning("parameter_changed", extra={"vehicle": vehicle.id, "reason": text})

    def _settle(self, vehicle: Vehicle, values: Mapping[str, ParameterValue]) -> None:
        changed, needed = self._changed.get(vehicle.id, {}), self._needed(vehicle.id)
        right = [
            name for name, requirement in needed.items() if requirement.holds(values.get(name, math.nan))
        ]
        for name in [name for name in changed if name in right or name not in needed]:
            del changed[name]
            log.info("parameter_right_again", extra={"vehicle": vehicle.id, "reason": name})
        if not changed:
            self._changed.pop(vehicle.id, None)

    def checks(self, vehicle_id: VehicleId, *, reads_again: bool = True) -> list[Check]:
        """Return the checks of its version and parameters.

        If any fails they are read again, unless `reads_again` is false: it may be fixed by then.
        """
        needed = self._required(vehicle_id)
        versions, version = self._requirements.profiles[vehicle_id].versions, self._versions.get(vehicle_id)
        read, problem = self._parameters.get(vehicle_id), self._problems.get(vehicle_id)
        checks = version_checks(versions, version)
        if not versions.is_too_old(version):
            checks += parameter_checks(needed, read, problem, missing_to_do(versions, version))
        if reads_again and not all(check.passes for check in checks):
            self._due[self._vehicles[vehicle_id].row] = True
        return checks

    def risks(self) -> list[str]:
        """Return what remains unsafe on the versions of some autopilots, with the vehicles, in words."""
        vehicles_of: dict[str, list[VehicleId]] = {}
        for vehicle_id, profile in self._requirements.profiles.items():
            read = self._parameters.get(vehicle_id)
            if read is None:
                continue
            version = self._versions.get(vehicle_id)
            risks = remaining_risks(self._required(vehicle_id), read)
            for text in [*risks, *version_risks(profile.versions, version)]:
                vehicles_of.setdefault(text, []).append(vehicle_id)
        return [f"{', '.join(names)}: {text}" for text, names in vehicles_of.items()]

    def _forget(self, vehicle: Vehicle) -> None:
        self._parameters.pop(vehicle.id, None)
        self._problems.pop(vehicle.id, None)
        version_s = -np.inf if vehicle.id in self._versions else self._newest.state.time_s + VERSION_S
        self._not_before_s[vehicle.row] = version_s
        self._due[vehicle.row] = self._outdated[vehicle.row] = True

    def _begin(self, vehicle: Vehicle) -> None:
        self._due[vehicle.row] = self._outdated[vehicle.row] = False
        self._reading[vehicle.row] = True
        self._announced[vehicle.id] = {}
        self._group.create_task(self._read(vehicle), name=f"parameters/{vehicle.id}")

    async def _read(self, vehicle: Vehicle) -> None:
        row = vehicle.row
        try:
            read = await read_needed(self._link_of[vehicle.id], vehicle.id, self._required(vehicle.id))
        except CommandError as error:
            self._problems[vehicle.id] = str(error)
            self._not_before_s[row] = self._newest.state.time_s + RETRY_S
            self._due[row] = True
        else:
            if not self._outdated[row]:  # it has not restarted, flown or been silent meanwhile
                values = {**read, **self._announced[vehicle.id]}  # what was set after it had been read
                self._note_parameters(vehicle, values)
                self._settle(vehicle, values)
                self._problems.pop(vehicle.id, None)
                log.info("parameters_read", extra={"vehicle": vehicle.id})
        finally:
            self._reading[row] = False
