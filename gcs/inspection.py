"""Reads the vehicles' parameters while they stand on the ground, and says what is wrong with them.

Beside the tick, never in it: reading takes up to seconds, and a vehicle that does not answer keeps nobody
else waiting.
"""

import asyncio
import logging
from collections.abc import Sequence

from gcs.errors import OrderError
from gcs.flight import Flight
from gcs.parameters import check_parameters, requirements
from gcs.preflight import Finding
from gcs.state import VehicleId

log = logging.getLogger(__name__)

RETRY_S = 2.0
"""After a vehicle has not answered."""


class Inspection:
    """Keeps `Flight.parameters` true: read when a vehicle is met, after a reboot, and after every flight."""

    def __init__(self, group: asyncio.TaskGroup, flight: Flight) -> None:
        self._group = group
        self._flight = flight
        self._needed = requirements(flight.config.operation, flight.config.control)
        self._boots: dict[VehicleId, int] = {}
        self._due: set[VehicleId] = set()  # to be read (again), as soon as they are on the ground
        self._reading: set[VehicleId] = set()
        self._not_before_s: dict[VehicleId, float] = {}

    def watch(self) -> None:
        """Once a tick: begin to read whatever is to be read now."""
        flight = self._flight
        if not flight.config.operation.require_parameters:
            return
        now_s, silence_s = flight.fleet.time_s, flight.config.operation.silence_s
        for vehicle_id, (telemetry, at) in flight.telemetry.items():
            silent = not now_s - telemetry.heartbeat_time_s[at] <= silence_s
            if silent or self._boots.get(vehicle_id) != telemetry.boots[at]:
                self._boots[vehicle_id] = telemetry.boots[at]
                self._forget(vehicle_id)
            if telemetry.armed[at]:
                self._due.add(vehicle_id)  # who flies may be changed by others meanwhile
                continue
            waits = vehicle_id in self._reading or now_s < self._not_before_s.get(vehicle_id, now_s)
            if not silent and vehicle_id in self._due and not waits:
                self._begin(vehicle_id)

    def findings(self, vehicles: Sequence[VehicleId]) -> list[Finding]:
        """What speaks against flying them. Who it concerns is read again: it may be mended by then."""
        flight = self._flight
        found = check_parameters(vehicles, self._needed, flight.parameters, flight.parameter_problems)
        self._due |= {finding.vehicle_id for finding in found}
        return found

    def _forget(self, vehicle_id: VehicleId) -> None:
        self._flight.parameters.pop(vehicle_id, None)
        self._flight.parameter_problems.pop(vehicle_id, None)
        self._not_before_s.pop(vehicle_id, None)
        self._due.add(vehicle_id)

    def _begin(self, vehicle_id: VehicleId) -> None:
        self._due.discard(vehicle_id)
        self._reading.add(vehicle_id)
        self._group.create_task(self._read(vehicle_id), name=f"parameters/{vehicle_id}")

    async def _read(self, vehicle_id: VehicleId) -> None:
        flight, life = self._flight, self._boots[vehicle_id]
        names = [requirement.name for requirement in self._needed]
        try:
            values = await flight.link_of[vehicle_id].read_parameters(vehicle_id, names)
        except OrderError as error:
            flight.parameter_problems[vehicle_id] = str(error)
            self._not_before_s[vehicle_id] = flight.fleet.time_s + RETRY_S
            self._due.add(vehicle_id)
        else:
            if self._boots[vehicle_id] == life and vehicle_id not in self._due:
                flight.parameters[vehicle_id] = values
                flight.parameter_problems.pop(vehicle_id, None)
                log.info("parameters_read", extra={"vehicle": vehicle_id})
        finally:
            self._reading.discard(vehicle_id)
