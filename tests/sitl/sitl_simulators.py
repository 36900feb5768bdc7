"""The vehicles of a SITL flight: instances of a real PX4 or ArduCopter, of a container, or of the fake fleet.

All stand on the same pads and talk to port 14540 + i (or another base). PX4 and the fake fleet send the
simulator's true state (HIL_STATE_QUATERNION) to port 19410 + i; what ArduCopter sends: `sitl_truth`.
"""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from gcs.cli.demo import MIXED
from gcs.links.autopilots import AUTOPILOTS, DEFAULT
from gcs.model.frames import ShowFrame
from gcs.sim.autopilots.ardupilot.parameters import defaults as ardupilot_defaults
from tests.support.processes import AT_ONCE, READY_AT_ONCE

PX4_PORT, PX4_SIMULATOR_PORT = 14540, 19410
PX4_MODEL = "sihsim_quadx"
STATION_PORT, TRUTH_PORT = PX4_PORT, PX4_SIMULATOR_PORT
"""Addresses that are given to ArduCopter: the same ports."""

DELIVERED = Path("Tools/autotest/default_params/copter.parm")
CALIBRATION = re.compile(
    r"FRAME_|RC\d+_(MIN|MAX|TRIM)$|COMPASS_(OFS|DIA|ODI)|INS_ACC\d?(OFFS|SCAL)|BATT_MONITOR$"
)

COLUMNS = 3
"""Pads stand in rows of three: row i // 3 to the north, column i % 3 to the east of the show's origin."""

ENDS_S = 10.0


@dataclass(frozen=True, slots=True)
class Pads:
    """Where the vehicles start."""

    frame: ShowFrame
    count: int
    spacing_m: float

    def geodetic(self) -> list[tuple[float, float, float]]:
        """Latitude, longitude (degrees) and altitude AMSL (m) of each pad."""
        index = np.arange(self.count)
        ned_m = self.spacing_m * np.stack([index // COLUMNS, index % COLUMNS, 0 * index], axis=1).astype(
            np.float64
        )
        places = zip(*self.frame.geodetic(self.frame.from_ned(ned_m)), strict=True)
        return [
            (float(latitude), float(longitude), float(altitude)) for latitude, longitude, altitude in places
        ]


class Simulators(Protocol):
    """The running vehicles."""

    @property
    def autopilot(self) -> str:
        """What flies: for the report."""
        ...

    @property
    def kinds(self) -> Sequence[str]:
        """Autopilot of each vehicle, as in a configuration; in turn from the first."""
        ...

    def start(self) -> None:
        """Start every vehicle. Raises: OSError when a program is missing."""
        ...

    def kill(self, index: int) -> None:
        """End one vehicle with SIGKILL, as a crash does."""
        ...

    def close(self) -> None:
        """End all vehicles."""
        ...


class Processes:
    """Processes that are ended together."""

    def __init__(self) -> None:
        self._running: dict[int, subprocess.Popen[bytes]] = {}

    def start(
        self, index: int, command: Sequence[str], *, folder: Path, environment: dict[str, str] | None = None
    ) -> None:
        """Start the process of vehicle `index`; its output lies in `folder`."""
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / "log").open("wb") as log:
            self._running[index] = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                cwd=folder,
                env=os.environ | (environment or {}),
            )

    def kill(self, index: int) -> None:
        """End one with SIGKILL."""
        self._running[index].kill()
        self._running[index].wait()

    def close(self) -> None:
        """End all; what does not end is killed."""
        for process in self._running.values():
            process.terminate()
        for process in self._running.values():
            try:
                process.wait(ENDS_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


class Px4Build:
    """Instances of a PX4 that was built with `make px4_sitl_default` (v1.14 or newer has SIH on a host)."""

    autopilot = "PX4"
    kinds = ("px4",)

    def __init__(self, build: Path, pads: Pads, folder: Path) -> None:
        """`build` holds bin/px4 and etc. Raises: FileNotFoundError saying what is missing."""
        for name in ("bin/px4", "etc/init.d-posix/rcS"):
            if not (build / name).exists():
                raise FileNotFoundError(
                    f"{build / name} is missing: PX4 must be a build folder, as .../build/px4_sitl_default"
                )
        self._build = build.resolve()
        self._pads = pads
        self._folder = folder
        self._processes = Processes()

    def start(self) -> None:
        """Each in a folder of its own, where it keeps its parameters and logs."""
        for index, place in enumerate(self._pads.geodetic()):
            command = [str(self._build / "bin/px4"), "-i", str(index), "-d", str(self._build / "etc")]
            self._processes.start(
                index, command, folder=self._folder / f"px4-{index}", environment=_environment(place)
            )

    def kill(self, index: int) -> None:
        """End one vehicle with SIGKILL."""
        self._processes.kill(index)

    def close(self) -> None:
        """End all vehicles."""
        self._processes.close()


class Px4Image:
    """Instances of a PX4 in containers of one image, on the host's network."""

    autopilot = "PX4 (container)"
    kinds = ("px4",)

    def __init__(self, image: str, pads: Pads, folder: Path) -> None:
        """Raises: FileNotFoundError without docker or podman."""
        engine = shutil.which("docker") or shutil.which("podman")
        if engine is None:
            raise FileNotFoundError("neither docker nor podman is installed: PX4_IMAGE needs one of them")
        self._engine, self._image, self._pads, self._folder = engine, image, pads, folder
        self._processes = Processes()

    def _name(self, index: int) -> str:
        return f"formation-gcs-sitl-{os.getpid()}-{index}"

    def start(self) -> None:
        """The image's own entry point starts PX4, and passes `-i` on to it, as px4io/px4-sitl does."""
        for index, place in enumerate(self._pads.geodetic()):
            command = [self._engine, "run", "--rm", "--network", "host", "--name", self._name(index)]
            for name, value in _environment(place).items():
                command += ["--env", f"{name}={value}"]
            command += [self._image, "-i", str(index)]
            self._processes.start(index, command, folder=self._folder / f"px4-{index}")

    def kill(self, index: int) -> None:
        """End one vehicle with SIGKILL."""
        subprocess.run([self._engine, "kill", "--signal", "KILL", self._name(index)], check=True)

    def close(self) -> None:
        """End all vehicles; docker's client passes SIGTERM on."""
        self._processes.close()


class ArduCopter:
    """Instances of an ArduCopter that was built for SITL (4.1 or newer)."""

    autopilot = "ArduCopter"
    kinds = ("ardupilot",)

    def __init__(
        self,
        binary: Path,
        pads: Pads,
        folder: Path,
        *,
        port: int = STATION_PORT,
        truth_port: int = TRUTH_PORT,
    ) -> None:
        """`binary` is arducopter itself. Raises: FileNotFoundError saying what is missing."""
        if not os.access(binary, os.X_OK) or binary.is_dir():
            raise FileNotFoundError(
                f"{binary}: ARDUPILOT must be the program, as .../build/sitl/bin/arducopter"
            )
        self._binary, self._pads, self._folder = binary.resolve(), pads, folder
        self._port, self._truth_port = port, truth_port
        self._processes = Processes()

    def start(self) -> None:
        """Each in a folder of its own, where it keeps its parameters and logs."""
        known = subprocess.run(
            [self._binary, "--help"], capture_output=True, text=True, timeout=ENDS_S, check=False
        )
        options = known.stdout + known.stderr
        for index, place in enumerate(self._pads.geodetic()):
            folder = self._folder / f"ardupilot-{index}"
            folder.mkdir(parents=True, exist_ok=True)
            own = folder / "own.parm"
            delivered = self._delivered()
            own.write_text(parameter_file(index, calibrated=not delivered), encoding="ascii")
            files = ",".join(str(file) for file in (*delivered, own))
            self._processes.start(index, self._command(index, place, options, files), folder=folder)

    def _delivered(self) -> list[Path]:
        """The parameters of SITL in the tree that holds the program, if it lies in one."""
        found = [parent / DELIVERED for parent in self._binary.parents]
        return [file for file in found if file.is_file()][:1]

    def _command(self, index: int, place: tuple[float, float, float], options: str, files: str) -> list[str]:
        """`options`: what the program says of itself; the names of its options have changed."""
        serial = ("--serial0", "--serial1") if "--serial0" in options else ("--uartA", "--uartC")
        latitude_deg, longitude_deg, altitude_amsl_m = place
        return [
            *(str(self._binary), "--model", "+", "--speedup", "1", "--instance", str(index)),
            *("--home", f"{latitude_deg:.9f},{longitude_deg:.9f},{altitude_amsl_m:.3f},0"),
            *(serial[0], f"udpclient:127.0.0.1:{self._port + index}"),
            *(serial[1], f"udpclient:127.0.0.1:{self._truth_port + index}"),
            *("--defaults", files, "--fg", "127.0.0.1"),
            *(["--enable-fgview"] if "--enable-fgview" in options else []),
        ]

    def kill(self, index: int) -> None:
        """End one vehicle with SIGKILL."""
        self._processes.kill(index)

    def close(self) -> None:
        """End all vehicles."""
        self._processes.close()


def parameter_file(index: int, *, calibrated: bool) -> str:
    """What instance `index` must have from its start; `gcs params apply` sets the rest.

    `calibrated`: also frame, radio and calibrations, which are those of the recorded SITL. Without them it
    refuses to arm, and a program without its tree has none. A version ignores names that it does not know.
    """
    recorded = {
        name: value for name, value in ardupilot_defaults().items() if calibrated and CALIBRATION.match(name)
    }
    own = {"SYSID_THISMAV": index + 1, "MAV_SYSID": index + 1, "FS_THR_ENABLE": 0}
    return "".join(f"{name} {value:.9g}\n" for name, value in {**recorded, **own}.items())


class FakeFleet:
    """The fake fleet; the vehicle that is lost on the way flies in a process of its own."""

    def __init__(
        self, pads: Pads, folder: Path, *, port: int, simulator_port: int, lost: int, autopilot: str = "px4"
    ) -> None:
        """`lost` is the index of the vehicle that can be killed; `autopilot` may be mixed."""
        frame = pads.frame
        self.autopilot = f"fake fleet, {autopilot}"
        self.kinds = tuple(AUTOPILOTS) if autopilot == MIXED else (autopilot,)
        self._command = [
            *(
                sys.executable,
                "-m",
                "gcs.sim",
                "--port-base",
                str(port),
                "--simulator-link",
                str(simulator_port),
            ),
            *("--autopilot", autopilot),
            *("--origin", f"{frame.latitude_deg},{frame.longitude_deg},{frame.altitude_amsl_m}"),
            *("--grid-columns", str(COLUMNS), "--spacing", f"{pads.spacing_m:g}"),
            *(AT_ONCE if DEFAULT.name in self.kinds else READY_AT_ONCE),
        ]
        self._count, self._lost, self._folder = pads.count, lost, folder
        self._processes = Processes()

    def start(self) -> None:
        """Up to three processes: before, itself and after the vehicle that can be killed."""
        parts = [(0, self._lost), (self._lost, self._lost + 1), (self._lost + 1, self._count)]
        for first, end in parts:
            if first < end:
                some = ["--first", str(first), "--count", str(end - first)]
                self._processes.start(first, [*self._command, *some], folder=self._folder / f"fake-{first}")

    def kill(self, index: int) -> None:
        """End one vehicle with SIGKILL. Raises: ValueError for another than the one named at the start."""
        if index != self._lost:
            raise ValueError(
                f"vehicle {index} shares its process with others; only {self._lost} can be killed"
            )
        self._processes.kill(index)

    def close(self) -> None:
        """End all vehicles."""
        self._processes.close()


def _environment(place: tuple[float, float, float]) -> dict[str, str]:
    """What PX4's start script reads: the model, and where it stands."""
    latitude_deg, longitude_deg, altitude_amsl_m = place
    return {
        "PX4_SIM_MODEL": PX4_MODEL,
        "PX4_HOME_LAT": f"{latitude_deg:.9f}",
        "PX4_HOME_LON": f"{longitude_deg:.9f}",
        "PX4_HOME_ALT": f"{altitude_amsl_m:.3f}",
    }
