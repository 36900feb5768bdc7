"""Stands in for PX4 SITL with SIH: its options, files, ports and simulator link, over the fake fleet.

    px4 -i INSTANCE -d ETC       # in a working folder, with PX4_SIM_MODEL and PX4_HOME_* in its environment

As the real one it makes a folder `log` in its working folder, and ends with 255 where it cannot. Its home is
float32. STANDIN_PORT and STANDIN_SIMULATOR_PORT replace 14540 and 19410.
"""

import os
import struct
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from tests.sitl.sitl_simulators import PX4_MODEL, SIMULATOR_PORT, STATION_PORT
from tests.sitl.standin import HOST, Faults, Surface

CANNOT = 255


class Px4Surface(Surface):
    """As v1.16: the simulator link carries the fake fleet's messages as they are."""

    faults: ClassVar[Faults] = {
        ("SIM_GPS_USED", 0): {"fault": "fix", "type": "none"},
        ("SIM_GPS_USED", 10): {"fault": "none"},
        ("SIM_BAT_MIN_PCT", 3.0): {"fault": "battery", "remaining": 0.06},
        ("SIM_BAT_MIN_PCT", 100.0): {"fault": "battery", "remaining": 1.0},
    }

    def of_states(self, data: bytes) -> None:
        """See `Surface`."""
        self.send(data)


def main(words: Sequence[str]) -> int:
    """Fly one vehicle until it is stopped. Returns: the exit code."""
    try:
        index, files = int(words[words.index("-i") + 1]), Path(words[-1])
    except (ValueError, IndexError):
        return _cannot("usage: px4 [-d] [-i <instance>] [rootfs_directory]")
    if not (files / "init.d-posix/rcS").is_file():
        return _cannot(f"ERROR [px4] no startup script in {files}")
    if os.environ.get("PX4_SIM_MODEL") != PX4_MODEL:
        return _cannot("ERROR [init] Unknown model")
    try:
        Path("log").mkdir(exist_ok=True)
    except FileExistsError:
        return _cannot("ERROR [px4] Failed to create directory: log")
    Path("parameters.bson").touch()
    print(f"INFO  [px4] instance: {index}", flush=True)
    home = ",".join(str(_float32(os.environ[f"PX4_HOME_{name}"])) for name in ("LAT", "LON", "ALT"))
    station, simulator = _port("STANDIN_PORT", STATION_PORT), _port("STANDIN_SIMULATOR_PORT", SIMULATOR_PORT)
    surface = Px4Surface(index, (HOST, simulator + index))
    return surface.fly(["--port-base", str(station), "--origin", home])


def _float32(text: str) -> float:
    value: float = struct.unpack("<f", struct.pack("<f", float(text)))[0]
    return value


def _port(variable: str, usual: int) -> int:
    return int(os.environ.get(variable, usual))


def _cannot(why: str) -> int:
    print(why, flush=True)
    return CANNOT


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
