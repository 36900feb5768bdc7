"""The vehicles of a SITL flight: instances of a real PX4 or ArduCopter, or of a container.

All stand on the same pads and talk to port 14540 + i (or another base). PX4 and the fake fleet send the
simulator's true state (HIL_STATE_QUATERNION) to port 19410 + i; what ArduCopter sends: `sitl_truth`.
"""

import os
import re
import subprocess
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Protocol, TypeAlias

import numpy as np

from gcs.model.frames import ShowFrame
from gcs.model.state import Array
from gcs.sim.autopilots.ardupilot.parameters import defaults as ardupilot_defaults
from tests.sitl.sitl_programs import ARDUCOPTER, PX4, container_engine, find, px4_files

STATION_PORT, SIMULATOR_PORT = 14540, 19410
"""Instance i of PX4 sends to these ports + i by itself; ArduCopter is given the same."""

PX4_MODEL = "sihsim_quadx"
DELIVERED = Path("Tools/autotest/default_params/copter.parm")
CALIBRATION = re.compile(
    r"FRAME_|RC\d+_(MIN|MAX|TRIM)$|COMPASS_(OFS|DIA|ODI)|INS_ACC\d?(OFFS|SCAL)|BATT_MONITOR$"
)

COLUMNS = 3
"""Pads stand in rows of three: row i // 3 to the north, column i % 3 to the east of the show's origin."""

ENDS_S = 10.0
ANSWERS_S = 60.0
LAST_LINES = 5

Place: TypeAlias = tuple[float, float, float]
"""Latitude, longitude (degrees) and altitude AMSL (m)."""

Faults: TypeAlias = Mapping[str, Mapping[str, float | int]]
"""Parameters of a simulation that make each fault; whole numbers are integers."""


class CannotError(Exception):
    """These simulators cannot do what a chapter needs; the message says what."""


@dataclass(frozen=True, slots=True)
class Pads:
    """Where the vehicles start."""

    frame: ShowFrame
    count: int
    spacing_m: float

    def ned_m(self) -> Array:
        """(n, 3) each pad, north, east and down of the show's origin."""
        row, column = np.divmod(np.arange(self.count, dtype=np.float64), COLUMNS)
        return np.asarray(self.spacing_m * np.stack([row, column, np.zeros(self.count)], axis=1))

    def geodetic(self) -> list[Place]:
        """The place of each pad."""
        places = zip(*self.frame.geodetic(self.frame.from_ned(self.ned_m())), strict=True)
        return [
            (float(latitude), float(longitude), float(altitude)) for latitude, longitude, altitude in places
        ]


class SimulatorLink(Protocol):
    """Sets parameters of one instance over its simulator link."""

    def set_parameters(self, index: int, values: Mapping[str, float | int]) -> None:
        """Raises: OSError when that instance has sent nothing yet."""
        ...


@dataclass(frozen=True, slots=True)
class Started:
    """How a process is started."""

    command: Sequence[str]
    environment: Mapping[str, str] = field(default_factory=dict)


class Simulators(ABC):
    """The running vehicles, each a process with a working folder of its own.

    Attributes:
        autopilot: what flies, for the report.
        kinds: autopilot of each vehicle, as in a configuration; in turn from the first.
        faults: what can go wrong in them.
        pads: where they stand.
    """

    autopilot: str
    kinds: Sequence[str]
    faults: ClassVar[Faults] = {}

    def __init__(self, pads: Pads, folder: Path) -> None:
        self.pads, self._folder = pads, folder
        self._running: dict[int, subprocess.Popen[bytes]] = {}

    @abstractmethod
    def _started(self, index: int, working: Path) -> Started:
        """How instance `index` is started in that folder."""

    @property
    def _firsts(self) -> Sequence[int]:
        """Instances that have a process."""
        return range(self.pads.count)

    def start(self) -> None:
        """Start every vehicle. Raises: OSError when a program is missing."""
        for index in self._firsts:
            self.restart(index)

    def restart(self, index: int) -> None:
        """Start a vehicle, also again, on its pad.

        What it prints lies beside its working folder: a program may make any file there, as PX4 its `log`.
        """
        name = f"{type(self).__name__.lower()}-{index}"
        working = self._folder / name
        working.mkdir(parents=True, exist_ok=True)
        how = self._started(index, working)
        with self._output(index).open("ab") as output:
            self._running[index] = subprocess.Popen(
                how.command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                cwd=working,
                env=os.environ | how.environment,
            )

    def kill(self, index: int) -> None:
        """End one vehicle with SIGKILL, as a crash does."""
        self._running[index].kill()
        self._running[index].wait()

    def inject(self, fault: str, index: int, link: SimulatorLink) -> None:
        """Let something go wrong in one vehicle. Raises: CannotError."""
        if fault not in self.faults:
            raise CannotError(f"{self.autopilot} has no fault '{fault}'")
        link.set_parameters(index, self.faults[fault])

    def ended(self) -> str:
        """Which processes have ended by themselves, with their last lines; empty: none has."""
        return "; ".join(
            f"instance {index} ended with exit code {process.returncode}: {self._last_lines(index)}"
            for index, process in self._running.items()
            if process.poll() is not None
        )

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

    def _output(self, index: int) -> Path:
        return self._folder / f"{type(self).__name__.lower()}-{index}.out"

    def _last_lines(self, index: int) -> str:
        lines = self._output(index).read_text(encoding="utf-8", errors="replace").splitlines()
        return " | ".join(lines[-LAST_LINES:]) or "it printed nothing"


class Px4Build(Simulators):
    """Instances of a PX4 that was built with `make px4_sitl_default` (v1.14 or newer has SIH on a host)."""

    autopilot = "PX4"
    kinds = ("px4",)
    faults: ClassVar[Faults] = {
        "gps-lost": {"SIM_GPS_USED": 0},
        "gps-back": {"SIM_GPS_USED": 10},
        "battery-low": {"SIM_BAT_MIN_PCT": 3.0, "SIM_BAT_DRAIN": 30.0},
        "battery-full": {"SIM_BAT_MIN_PCT": 100.0},
    }

    def __init__(self, given: str | None, pads: Pads, folder: Path) -> None:
        """`given`: the program or a folder above it; None: it is looked for. Raises: NotFoundError."""
        super().__init__(pads, folder)
        self._program = find(PX4, given)
        self._files = px4_files(self._program)
        self._places = pads.geodetic()

    def _started(self, index: int, working: Path) -> Started:
        command = [str(self._program), "-i", str(index), "-d", str(self._files)]
        return Started(command, _environment(self._places[index]))


class Px4Image(Simulators):
    """Instances of a PX4 in containers of one image, on the host's network."""

    autopilot = "PX4 (container)"
    kinds = ("px4",)
    faults = Px4Build.faults

    def __init__(self, image: str, pads: Pads, folder: Path) -> None:
        """Raises: NotFoundError without docker or podman, or the image."""
        super().__init__(pads, folder)
        self._engine, self._image, self._places = container_engine(image), image, pads.geodetic()

    def _name(self, index: int) -> str:
        return f"formation-gcs-sitl-{os.getpid()}-{index}"

    def _started(self, index: int, working: Path) -> Started:
        """The image's own entry point starts PX4, and passes `-i` on to it, as px4io/px4-sitl does."""
        command = [self._engine, "run", "--rm", "--network", "host", "--name", self._name(index)]
        for name, value in _environment(self._places[index]).items():
            command += ["--env", f"{name}={value}"]
        return Started([*command, self._image, "-i", str(index)])

    def kill(self, index: int) -> None:
        """End one vehicle with SIGKILL; docker's client ends with it."""
        subprocess.run([self._engine, "kill", "--signal", "KILL", self._name(index)], check=True)
        self._running[index].wait(ENDS_S)


class ArduCopter(Simulators):
    """Instances of an ArduCopter that was built for SITL (4.0 or newer)."""

    autopilot = "ArduCopter"
    kinds = ("ardupilot",)
    faults: ClassVar[Faults] = {
        "gps-lost": {"SIM_GPS_DISABLE": 1.0, "SIM_GPS1_ENABLE": 0.0},
        "gps-back": {"SIM_GPS_DISABLE": 0.0, "SIM_GPS1_ENABLE": 1.0},
        "battery-low": {"SIM_BATT_VOLTAGE": 10.0},
        "battery-full": {"SIM_BATT_VOLTAGE": 12.6},
    }
    """A version ignores names that it does not know."""

    def __init__(
        self,
        given: str | None,
        pads: Pads,
        folder: Path,
        *,
        port: int = STATION_PORT,
        simulator_port: int = SIMULATOR_PORT,
    ) -> None:
        """`given`: the program or a folder above it; None: it is looked for. Raises: NotFoundError."""
        super().__init__(pads, folder)
        self._program = find(ARDUCOPTER, given)
        self._port, self._simulator_port, self._places = port, simulator_port, pads.geodetic()
        self._options = _options(self._program)

    def _started(self, index: int, working: Path) -> Started:
        """The names of its options have changed with the versions."""
        serial = ("--serial0", "--serial1") if "--serial0" in self._options else ("--uartA", "--uartC")
        latitude_deg, longitude_deg, altitude_amsl_m = self._places[index]
        return Started(
            [
                *(str(self._program), "--model", "+", "--speedup", "1", "--instance", str(index)),
                *("--home", f"{latitude_deg:.9f},{longitude_deg:.9f},{altitude_amsl_m:.3f},0"),
                *(serial[0], f"udpclient:127.0.0.1:{self._port + index}"),
                *(serial[1], f"udpclient:127.0.0.1:{self._simulator_port + index}"),
                *("--defaults", self._defaults(index, working), "--fg", "127.0.0.1"),
                *(["--enable-fgview"] if "--enable-fgview" in self._options else []),
            ]
        )

    def _defaults(self, index: int, working: Path) -> str:
        """Files of parameters: SITL's of the tree that holds the program, if it lies in one, and ours."""
        found = [parent / DELIVERED for parent in self._program.parents]
        delivered = [file for file in found if file.is_file()][:1]
        own = working / "own.parm"
        own.write_text(parameter_file(index, calibrated=not delivered), encoding="ascii")
        return ",".join(str(file) for file in (*delivered, own))


def _options(program: Path) -> str:
    """What an ArduCopter says of its options."""
    asked = subprocess.run(
        [program, "--help"], capture_output=True, text=True, errors="replace", timeout=ANSWERS_S, check=False
    )
    return asked.stdout + asked.stderr


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


def _environment(place: Place) -> dict[str, str]:
    """What PX4's start script reads: the model, and where it stands."""
    latitude_deg, longitude_deg, altitude_amsl_m = place
    return {
        "PX4_SIM_MODEL": PX4_MODEL,
        "PX4_HOME_LAT": f"{latitude_deg:.9f}",
        "PX4_HOME_LON": f"{longitude_deg:.9f}",
        "PX4_HOME_ALT": f"{altitude_amsl_m:.3f}",
    }
