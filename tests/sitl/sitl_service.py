"""The service under test: `gcs params apply` and `gcs serve`, as an operator types them, in processes."""

import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import yaml

from gcs.client import Client
from gcs.config import schema as configuration
from gcs.links.autopilots import AUTOPILOTS
from gcs.model.errors import GcsError

GCS = (sys.executable, "-m", "gcs")
APPLIED_S = 600.0
ANSWERS_S = 180.0


class ServiceError(RuntimeError):
    """The service, or a command of it, did not do what the flight needs."""


class Service:
    """`gcs serve` with its own configuration and record; can be stopped, continued, killed and restarted.

    Where the configuration has several stations, each is a process. The client is that of the first one.
    """

    def __init__(self, config: configuration.Config, folder: Path) -> None:
        """Writes the configuration into `folder`; starts nothing."""
        self.config = config
        self.folder = folder
        self._file = folder / "sitl.yaml"
        shows = folder / "shows"
        shows.mkdir(exist_ok=True)
        kept = {"record": {"folder": str(folder)}, "shows": {"folder": str(shows)}}
        raw = config.model_dump(mode="json") | kept
        self._file.write_text(yaml.safe_dump(raw), encoding="utf-8")
        self.stations = [station.name for station in config.stations] or [""]
        self._processes: dict[str, subprocess.Popen[str]] = {}
        self._clients: dict[str, Client] = {}
        self.urls: dict[str, str] = {}

    def config_alone(self) -> dict[str, bool]:
        """Whether each vehicle changes its mode by itself without setpoints."""
        action, loss_s = self.config.operation.setpoint_loss_action, self.config.operation.setpoint_loss_s
        return {
            name: AUTOPILOTS[kind].without_setpoints(action, loss_s, {}).changes_mode
            for name, kind in self.config.autopilots.items()
        }

    def apply_parameters(self) -> None:
        """Set what a safe loss of the station needs. Raises: ServiceError with what the command printed."""
        command = [*GCS, "params", "apply", "--config", str(self._file)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=APPLIED_S, check=False)
        if done.returncode != 0:
            raise ServiceError(f"gcs params apply: exit {done.returncode}\n{done.stdout}{done.stderr}")

    @property
    def client(self) -> Client:
        """Of the first station that runs. Raises: ServiceError when none does."""
        for station in self.stations:
            if station in self._clients:
                return self._clients[station]
        raise ServiceError("gcs serve was not started")

    @property
    def url(self) -> str:
        """Of the same station."""
        return next((self.urls[station] for station in self.stations if station in self._clients), "")

    def start(self) -> None:
        """Start what does not run, and wait until it answers. Raises: ServiceError."""
        waiting = [station for station in self.stations if station not in self._processes]
        for station in waiting:
            command = [*GCS, "serve", "--config", str(self._file), "--quiet"]
            command += ["--station", station] if station else []
            with self._log(station).open("a") as log:
                process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)
            self._processes[station] = process
        for station in waiting:
            self._clients[station] = self._connected(station)

    def _connected(self, station: str) -> Client:
        output = self._processes[station].stdout
        address = re.search(r"http://\S+:\d+", "" if output is None else output.readline())
        if address is None:
            raise ServiceError(f"gcs serve did not start; see {self._log(station)}")
        self.urls[station] = address[0]
        client = Client(address[0], timeout_s=30.0)
        deadline_s = time.monotonic() + ANSWERS_S
        while True:
            try:
                client.health()
            except GcsError as error:
                if time.monotonic() > deadline_s:
                    raise ServiceError(f"gcs serve does not answer: {error}") from error
                time.sleep(0.1)
            else:
                return client

    def _log(self, station: str) -> Path:
        return self.folder / f"service{station and '-'}{station}.log"

    def stop_for(self, seconds: float) -> None:
        """SIGSTOP, wait, SIGCONT: as a machine that hangs."""
        for process in self._processes.values():
            process.send_signal(signal.SIGSTOP)
        time.sleep(seconds)
        for process in self._processes.values():
            process.send_signal(signal.SIGCONT)

    def kill(self, station: str | None = None) -> None:
        """SIGKILL: as a crash, of one station or all."""
        for name in list(self._processes) if station is None else [station]:
            process = self._processes.pop(name)
            process.send_signal(signal.SIGKILL)
            process.communicate()
            if name in self._clients:
                self._clients.pop(name).close()

    def close(self) -> None:
        """End it, whatever state it is in."""
        self.kill()
