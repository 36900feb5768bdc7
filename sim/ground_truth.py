"""True states of the vehicles, for reports and tests. No autopilot reads them."""

import socket
from typing import BinaryIO

import numpy as np
from pydantic_core import to_json
from pymavlink.dialects.v20 import common

from gcs.sim.mixed import AnyFleet
from gcs.sim.targets.motions import Motion

HOST = "127.0.0.1"
PERIOD_S = 0.05


class Period:
    """Says when something that happens once a period is due; what is late is not made up for."""

    def __init__(self, period_s: float) -> None:
        self._period_s, self._next_s = period_s, 0.0

    def is_due(self, time_s: float) -> bool:
        if time_s < self._next_s:
            return False
        late = time_s - self._next_s > self._period_s
        self._next_s = (time_s if late else self._next_s) + self._period_s
        return True


class GroundTruthFile:
    """Writes one line per sample, and flushes it: killed at any moment, at most one line is lost."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._due = Period(PERIOD_S)

    def offer(self, fleet: AnyFleet, time_s: float) -> None:
        """Write a line if one is due at time_s (CLOCK_MONOTONIC)."""
        if not self._due.is_due(time_s):
            return
        self._file.write(to_json(sample(fleet, time_s)) + b"\n")
        self._file.flush()


class TargetTruthFile:
    """The same of a target: one line with each report, north and east of its origin."""

    def __init__(self, file: BinaryIO, motion: Motion) -> None:
        self._file, self._motion = file, motion

    def note(self, time_s: float, since_s: float) -> None:
        """Write where it is at time_s (CLOCK_MONOTONIC), since_s after it began to move."""
        state = self._motion(since_s)
        line = {"time_s": round(time_s, 6), "ned_m": [round(each, 4) for each in state[:3]]}
        self._file.write(to_json(line) + b"\n")
        self._file.flush()


def sample(fleet: AnyFleet, time_s: float) -> dict[str, object]:
    """The true state of every vehicle; north, east, down from the fleet's origin."""
    position_m, velocity_m_s = fleet.position_m, fleet.velocity_m_s
    geodetic = np.round(fleet.geodetic(position_m), 9)
    rows = zip(
        fleet.settings.indices,
        fleet.autopilots,
        np.round(position_m, 4).tolist(),
        np.round(velocity_m_s, 4).tolist(),
        geodetic.tolist(),
        strict=True,
    )
    return {
        "time_s": round(time_s, 6),
        "vehicles": [
            {
                "vehicle": index + 1,
                "system_id": autopilot.system_id,
                "north_m": north_m,
                "east_m": east_m,
                "down_m": down_m,
                "velocity_north_m_s": north_m_s,
                "velocity_east_m_s": east_m_s,
                "velocity_down_m_s": down_m_s,
                "latitude_deg": latitude_deg,
                "longitude_deg": longitude_deg,
                "altitude_amsl_m": round(altitude_amsl_m, 4),
                "armed": autopilot.commander.armed,
                "landed": autopilot.commander.landed,
                "mode": autopilot.commander.mode.name,
                **autopilot.equipment.truth,
            }
            for (
                index,
                autopilot,
                (north_m, east_m, down_m),
                (north_m_s, east_m_s, down_m_s),
                (latitude_deg, longitude_deg, altitude_amsl_m),
            ) in rows
        ],
    }


SIMULATOR_PERIOD_S = 0.04
"""PX4 v1.16 sends the message at 25 Hz (ROMFS, px4-rc.mavlinksim)."""

FIRST_PORT = 19410
"""Instance i of PX4 sends to this port + i."""

COMPONENT_ID = 1

LEVEL_MG = -1000
"""Specific force of a level vehicle at rest. Attitude and rates are not modelled: level, heading north."""


class SimulatorLink:
    """Sends the true state of vehicle i to 127.0.0.1, port `first_port` + i. Nothing is received.

    As PX4 v1.16 does: the time is in HIL_ACTUATOR_CONTROLS, and that of HIL_STATE_QUATERNION is 0.
    """

    def __init__(self, first_port: int, count: int) -> None:
        self._first_port = first_port
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self.close = self._socket.close
        self._encoders = [common.MAVLink(None) for _ in range(count)]
        self._due = Period(SIMULATOR_PERIOD_S)

    def offer(self, fleet: AnyFleet, time_s: float) -> None:
        """Send the messages of each vehicle when they are due; `time_s` is the fleet's simulated time."""
        if not self._due.is_due(time_s):
            return
        geodetic = np.round(fleet.geodetic(fleet.position_m) * (1e7, 1e7, 1e3)).astype(np.int64).tolist()
        velocity_cm_s = np.round(100.0 * fleet.velocity_m_s).astype(np.int64).tolist()
        rows = zip(fleet.autopilots, self._encoders, geodetic, velocity_cm_s, strict=True)
        for index, (autopilot, encoder, place, speed_cm_s) in zip(fleet.settings.indices, rows, strict=True):
            encoder.srcSystem, encoder.srcComponent = autopilot.system_id, COMPONENT_ID
            state = encoder.hil_state_quaternion_encode(
                0,
                [1.0, 0.0, 0.0, 0.0],
                *(0.0, 0.0, 0.0),
                *place,
                *speed_cm_s,
                *(0, 0),
                *(0, 0, LEVEL_MG),
            )
            clock = encoder.hil_actuator_controls_encode(round(1e6 * time_s), [0.0] * 16, 0, 0)
            data = state.pack(encoder) + clock.pack(encoder)
            try:
                self._socket.sendto(data, (HOST, self._first_port + index))
            except (BlockingIOError, ConnectionRefusedError):
                continue  # no reader on that port: the flight does not depend on it
