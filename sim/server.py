"""The fleet on real UDP sockets and the real clock, and the input of fault commands. Thin."""

import os
import selectors
import signal
import socket
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing

from gcs.sim.endpoint import HOST, LARGEST, Endpoint, Port, PortError, Radio
from gcs.sim.faults.commands import LONGEST_LINE
from gcs.sim.faults.injector import FaultInjector
from gcs.sim.fleet import STEP_S, Fleet, Settings
from gcs.sim.ground_truth import GroundTruthFile, SimulatorLink


class StandardInput:
    """Newline-delimited JSON on this process's standard input; answers on its standard output."""

    _part = b""

    def fileno(self) -> int:
        return sys.stdin.fileno()

    def read(self, fault_injector: FaultInjector) -> bool:
        data = os.read(self.fileno(), LARGEST)
        *lines, self._part = (self._part + data).split(b"\n")
        if len(self._part) > LONGEST_LINE or (not data and self._part):
            lines.append(self._part)
            self._part = b""
        for line in lines:
            if line.strip():
                print(fault_injector.obey(line), flush=True)  # noqa: T201 - the command's output
        return bool(data)

    def close(self) -> None:
        """Standard input stays open."""


class ControlPort:
    """The same commands in UDP datagrams, answered to the sender."""

    def __init__(self, host: str, port: int) -> None:
        """Open it. Raises: PortError when the port is taken."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise PortError(f"udp port {port}: {error.strerror}") from error

    def fileno(self) -> int:
        return self._socket.fileno()

    def read(self, fault_injector: FaultInjector) -> bool:
        try:
            data, sender = self._socket.recvfrom(LARGEST)
            answers = [fault_injector.obey(line) for line in data.split(b"\n") if line.strip()]
            if answers:
                self._socket.sendto("\n".join(answers).encode() + b"\n", sender)
        except OSError:  # ICMP: the sender no longer listens
            pass
        return True

    def close(self) -> None:
        self._socket.close()


CATCH_UP_S = 0.25  # a longer stall is dropped, as if the vehicles had been paused
REST_S = 0.002  # time in which datagrams of a continuous flow gather; PX4 answers in 1 to 4 ms
STOPS = (signal.SIGINT, signal.SIGTERM)


def serve(
    settings: Settings,
    ports: Sequence[Port],
    truth: GroundTruthFile | None,
    greeting: str,
    *,
    control_port: int | None = None,
    control_input: bool = False,
    simulator_port: int | None = None,
) -> None:
    """Fly the fleet until SIGINT or SIGTERM; print the greeting when it can be reached.

    With `simulator_port`, vehicle i sends its true state to that port + i, as PX4's SIH does.

    Raises: PortError when a port is taken.
    """
    with ExitStack() as stack:
        stops: list[int] = []
        for number in STOPS:
            before = signal.signal(number, lambda signum, _: stops.append(signum))
            stack.callback(signal.signal, number, before)
        fleet = Fleet(settings, start_s=time.monotonic(), unix_at_start_s=time.time())
        fault_injector = FaultInjector(fleet)
        endpoints = [
            stack.enter_context(closing(Endpoint(HOST, port, fleet.receiver.circle(port.rows))))
            for port in ports
        ]
        controls: list[StandardInput | ControlPort] = []
        if control_port is not None:
            controls.append(stack.enter_context(closing(ControlPort(HOST, control_port))))
        if control_input:
            controls.append(StandardInput())
        simulator = None
        if simulator_port is not None:
            simulator = stack.enter_context(closing(SimulatorLink(simulator_port, settings.count)))
        selector = stack.enter_context(selectors.DefaultSelector())
        for endpoint in endpoints:
            selector.register(endpoint, selectors.EVENT_READ, endpoint)
        for control in controls:
            try:
                selector.register(control, selectors.EVENT_READ, control)
            except PermissionError:  # a file cannot be waited for: its commands are executed now
                while control.read(fault_injector):
                    pass
        print(greeting, flush=True)  # noqa: T201 - the command's output
        radio = Radio(fleet, fault_injector, endpoints)
        for waited_s in _paced(fleet, radio, fault_injector, truth, simulator, stops):
            _read(selector, waited_s, radio, fault_injector)


def _paced(
    fleet: Fleet,
    radio: Radio,
    fault_injector: FaultInjector,
    truth: GroundTruthFile | None,
    simulator: SimulatorLink | None,
    stops: Sequence[int],
) -> Iterator[float]:
    """Step the fleet in time with the clock: whole steps, so nothing drifts; long stalls are dropped.

    Yields: how long to wait for datagrams.
    """
    dropped_s = time.monotonic() - fleet.time_s
    while not stops:
        behind_s = time.monotonic() - dropped_s - fleet.time_s
        if behind_s > CATCH_UP_S:
            dropped_s += behind_s - STEP_S
            fleet.unix_ahead_s += behind_s - STEP_S  # GPS time continues
            behind_s = STEP_S  # at least one step: a machine that is always late still flies, slowly
        for _ in range(int(behind_s / STEP_S + 1e-9)):
            fleet.step()
            fault_injector.pass_time()
            radio.send()
            if fault_injector.broken:
                radio.deliver()
            if truth is not None:
                truth.offer(fleet, fleet.time_s + dropped_s)
            if simulator is not None:
                simulator.offer(fleet, fleet.time_s)
        yield max(fleet.time_s + STEP_S + dropped_s - time.monotonic(), 0.0)


def _read(
    selector: selectors.BaseSelector, wait_s: float, radio: Radio, fault_injector: FaultInjector
) -> None:
    """Wait for datagrams until the next step at most, then give more of them a moment to gather."""
    if not (ready := selector.select(wait_s)):
        return
    readers = [key.data for key, _ in ready]
    for reader in readers:
        if not isinstance(reader, Endpoint) and not reader.read(fault_injector):
            selector.unregister(reader)
    radio.receive([reader for reader in readers if isinstance(reader, Endpoint)])
    if wait_s > REST_S:
        time.sleep(REST_S)
