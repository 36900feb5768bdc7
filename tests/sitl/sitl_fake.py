"""The fake fleet as the vehicles of a SITL flight."""

import json
import socket
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from gcs.cli.demo.demo import MIXED
from gcs.links.autopilots import AUTOPILOTS, DEFAULT
from tests.sitl.sitl_simulators import COLUMNS, CannotError, Pads, SimulatorLink, Simulators, Started
from tests.support.machine import free_ports
from tests.support.processes import AT_ONCE, READY_AT_ONCE

ANSWERS_S = 5.0
MODULE = ("-m", "gcs.sim")


@dataclass(frozen=True, slots=True, kw_only=True)
class FakeOptions:
    """How the fake fleet flies; empty version: the recorded one."""

    port: int
    simulator_port: int
    autopilot: str = DEFAULT.name
    version: str = ""
    seed: int = 0
    at_once: bool = False  # it can be armed at once, and is disarmed soon after landing


class FakeFleet(Simulators):
    """Up to three processes: before, itself and after the vehicle that can be killed.

    Attributes:
        kept: options with the parameters that a vehicle has when it starts again, as a real one keeps them.
    """

    messages: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "gps-lost": {"fault": "fix", "type": "none"},
        "gps-back": {"fault": "none"},
        "battery-low": {"fault": "battery", "remaining": 0.06},
        "battery-full": {"fault": "battery", "remaining": 1.0},
        "estimator-reset": {"fault": "position-reset", "north_m": 0.8, "east_m": -0.6},
    }

    def __init__(self, pads: Pads, folder: Path, options: FakeOptions, *, lost: int) -> None:
        """`lost` is the index of the vehicle that can be killed."""
        super().__init__(pads, folder)
        frame, kind = pads.frame, options.autopilot
        self.autopilot = f"fake fleet, {kind} {options.version}".strip()
        self.kinds = tuple(AUTOPILOTS) if kind == MIXED else (kind,)
        quick = AT_ONCE if DEFAULT.name in self.kinds else READY_AT_ONCE
        self._command = [
            *(sys.executable, *MODULE, "--autopilot", kind, "--seed", str(options.seed)),
            *(("--autopilot-version", options.version) if options.version else ()),
            *("--port-base", str(options.port), "--simulator-link", str(options.simulator_port)),
            *("--origin", f"{frame.latitude_deg},{frame.longitude_deg},{frame.altitude_amsl_m}"),
            *("--grid-columns", str(COLUMNS), "--spacing", f"{pads.spacing_m:g}"),
            *(quick if options.at_once else ()),
        ]
        self._parts = {
            first: range(first, end)
            for first, end in ((0, lost), (lost, lost + 1), (lost + 1, pads.count))
            if first < end
        }
        self.kept: Sequence[str] = ()
        self._controls = dict(zip(self._parts, range(free := free_ports(3), free + 3), strict=False))

    @property
    def _firsts(self) -> Sequence[int]:
        return list(self._parts)

    def _started(self, index: int, working: Path) -> Started:
        some = ["--first", str(index), "--count", str(len(self._parts[index]))]
        kept = self.kept if index in self._running else ()
        return Started([*self._command, *some, *kept, "--control", str(self._controls[index])])

    def kill(self, index: int) -> None:
        """End one vehicle with SIGKILL. Raises: CannotError for another than the one named at the start."""
        self._alone(index)
        super().kill(index)

    def restart(self, index: int) -> None:
        """Start a process, also again. Raises: CannotError for a vehicle that has none of its own."""
        if index not in self._parts:
            self._alone(index)
        super().restart(index)

    def inject(self, fault: str, index: int, link: SimulatorLink) -> None:
        """Send the fault to the vehicle's process. Raises: CannotError."""
        if fault not in self.messages:
            raise CannotError(f"the fake fleet has no fault '{fault}'")
        first = next(first for first, part in self._parts.items() if index in part)
        command = {"vehicle": index + 1, **self.messages[fault]}
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
            port.settimeout(ANSWERS_S)
            port.sendto(json.dumps(command).encode(), ("127.0.0.1", self._controls[first]))
            answer = json.loads(port.recv(4096))
        if not answer["ok"]:
            raise CannotError(f"the fake fleet refused '{fault}': {answer['error']}")

    def _alone(self, index: int) -> None:
        if len(self._parts.get(index, ())) != 1:
            raise CannotError(f"vehicle {index} shares its process with others")
