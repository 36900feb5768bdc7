"""Stands in for ArduPilot's SITL: its options, serial ports and FlightGear packets, over the fake fleet.

STANDIN_VERSION is the version: 4.0 has --uartA and --uartC, later ones --serial0 and --serial1. On both
serial ports it prints the text of its start, as the real one does before its first frame. Without
parameters (--defaults) it has neither frame nor calibrations, and never arms. STANDIN_FDM_PORT replaces 5503.
"""

import argparse
import math
import os
import socket
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import ClassVar

from pymavlink.dialects.v20 import common

from gcs.sim.cli import parameter_options
from gcs.sim.vehicle import versions
from tests.sitl.sitl_truth import FDM, FDM_PORT, FDM_PORTS_APART, FDM_VERSION
from tests.sitl.standin import HOST, Address, Faults, Surface

FDM_LENGTH = 408
TIMESYNC_EVERY_S = 10.0
DISCARD = 9  # a port on which nothing listens
CONSOLE = (
    "Init ArduCopter V{version}\r\n\r\nFree RAM: 131072\r\nBarometer 1 calibration complete\r\n"
    "Initialising APM...\r\nReady to FLY  "
)
BARE = {
    "FRAME_CLASS": 0,
    **{f"{sensor}_{axis}": 0 for sensor in ("COMPASS_OFS", "INS_ACCOFFS") for axis in "XYZ"},
}
"""What it has that was never set up."""


class ArduCopterSurface(Surface):
    """States as FGNetFDM; the second serial port prints and speaks MAVLink."""

    faults: ClassVar[Faults] = {
        ("SIM_GPS1_ENABLE", 0.0): {"fault": "fix", "type": "none"},
        ("SIM_GPS1_ENABLE", 1.0): {"fault": "none"},
        ("SIM_BATT_VOLTAGE", 10.0): {"fault": "battery", "remaining": 0.06},
        ("SIM_BATT_VOLTAGE", 12.6): {"fault": "battery", "remaining": 1.0},
    }

    def __init__(self, index: int, serial: Address, flight_gear: Address) -> None:
        super().__init__(index, serial)
        self._flight_gear, self._synced_s = flight_gear, -math.inf
        self._states = common.MAVLink(None)
        self._encoder = common.MAVLink(None, srcSystem=index + 1, srcComponent=1)

    def of_states(self, data: bytes) -> None:
        """The place of HIL_STATE_QUATERNION, big-endian, in radians; the time in TIMESYNC."""
        for message in self._states.parse_buffer(data) or ():
            if message.get_type() == "HIL_STATE_QUATERNION":
                place = math.radians(message.lon * 1e-7), math.radians(message.lat * 1e-7), message.alt * 1e-3
                packet = FDM.pack(FDM_VERSION, 0, *place).ljust(FDM_LENGTH, b"\0")
                with suppress(ConnectionRefusedError):
                    self._outside.sendto(packet, self._flight_gear)
            else:
                self._sync(message.time_usec)

    def _sync(self, time_us: int) -> None:
        if time.monotonic() - self._synced_s >= TIMESYNC_EVERY_S:
            self._synced_s = time.monotonic()
            self.send(common.MAVLink_timesync_message(0, 1000 * time_us).pack(self._encoder))


def main(words: Sequence[str]) -> int:
    """Fly one vehicle until it is stopped. Returns: the exit code."""
    version = os.environ.get("STANDIN_VERSION", "")
    given = _parser(version).parse_args(words)
    first, second = _address(given.first), _address(given.second)
    index = given.instance
    parameters = _parameters(given.defaults)
    if parameters.get("SYSID_THISMAV", parameters.get("MAV_SYSID", 1)) != index + 1:
        print(f"system id of instance {index} is not {index + 1}", file=sys.stderr)
        return 1
    text = CONSOLE.format(version=versions.find("ardupilot", version).software).encode()
    for address in (first, second):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
            port.sendto(text, address)
    fdm = int(os.environ.get("STANDIN_FDM_PORT", FDM_PORT)) + FDM_PORTS_APART * index
    surface = ArduCopterSurface(index, second, (given.fg, fdm))
    latitude, longitude, altitude, _yaw = given.home.split(",")
    listed = versions.find("ardupilot", version).parameters
    known = {name: value for name, value in {**BARE, **parameters}.items() if listed.knows(name)}
    return surface.fly(
        [
            *("--autopilot", "ardupilot", "--origin", f"{latitude},{longitude},{altitude}"),
            *("--port-base", str(first[1] - index), *parameter_options(known)),
        ]
    )


def _parser(version: str) -> argparse.ArgumentParser:
    """Words are whole, as getopt_long of the real program demands."""
    parser = argparse.ArgumentParser(prog="arducopter", allow_abbrev=False)
    old = version == "4.0"
    serial = ("--uartA", "--uartC") if old else ("--serial0", "--serial1")
    parser.add_argument(serial[0], dest="first", metavar="device", required=True)
    parser.add_argument(serial[1], dest="second", metavar="device", default=f"udpclient:{HOST}:{DISCARD}")
    for name in ("--model", "--home"):
        parser.add_argument(name, required=True)
    parser.add_argument("--speedup", type=float, default=1.0)
    parser.add_argument("--instance", type=int, default=0)
    parser.add_argument("--defaults", default="", metavar="path")
    parser.add_argument("--fg", default=HOST, metavar="ADDRESS")
    if not old:
        parser.add_argument("--enable-fgview", action="store_true")
    return parser


def _address(device: str) -> Address:
    kind, host, port = device.split(":")
    if kind != "udpclient":
        raise SystemExit(f"{device}: this stand-in has udpclient only")
    return host, int(port)


def _parameters(files: str) -> Mapping[str, float]:
    found: dict[str, float] = {}
    for file in filter(None, files.split(",")):
        for line in Path(file).read_text(encoding="ascii").splitlines():
            words = line.split("#")[0].replace(",", " ").split()
            if len(words) == 2:
                found[words[0]] = float(words[1])
    return found


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
