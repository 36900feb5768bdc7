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
APPLIED_S = 180.0
ANSWERS_S = 60.0


class ServiceError(RuntimeError):
    """The service, or a command of it, did not do what the flight needs."""


class Service:
    """`gcs serve` with its own configuration and record; can be stopped, continued, killed and restarted."""

    def __init__(self, config: configuration.Config, folder: Path) -> None:
        """Writes the configuration into `folder`; starts nothing."""
        self.config = config
        self._folder = folder
        self._file = folder / "sitl.yaml"
        raw = config.model_dump(mode="json") | {"record": {"folder": str(folder)}}
        self._file.write_text(yaml.safe_dump(raw), encoding="utf-8")
        self._process: subprocess.Popen[str] | None = None
        self.client: Client | None = None
        self.url = ""

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

    def start(self) -> Client:
        """Start it and wait until it answers. Raises: ServiceError."""
        command = [*GCS, "serve", "--config", str(self._file), "--quiet"]
        with (self._folder / "service.log").open("a") as log:
            self._process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)
        greeting = "" if self._process.stdout is None else self._process.stdout.readline()
        address = re.search(r"http://\S+:\d+", greeting)
        if address is None:
            raise ServiceError(f"gcs serve did not start; see {self._folder / 'service.log'}")
        if self.client is not None:
            self.client.close()
        self.url = address[0]
        self.client = Client(self.url, timeout_s=30.0)
        deadline_s = time.monotonic() + ANSWERS_S
        while True:
            try:
                self.client.health()
            except GcsError as error:
                if time.monotonic() > deadline_s:
                    raise ServiceError(f"gcs serve does not answer: {error}") from error
                time.sleep(0.1)
            else:
                return self.client

    def stop_for(self, seconds: float) -> None:
        """SIGSTOP, wait, SIGCONT: as a machine that hangs."""
        self._signal(signal.SIGSTOP)
        time.sleep(seconds)
        self._signal(signal.SIGCONT)

    def kill(self) -> None:
        """SIGKILL: as a crash."""
        self._signal(signal.SIGKILL)
        if self._process is not None:
            self._process.communicate()

    def close(self) -> None:
        """End it, whatever state it is in."""
        if self.client is not None:
            self.client.close()
        if self._process is not None and self._process.poll() is None:
            self.kill()

    def _signal(self, number: signal.Signals) -> None:
        if self._process is None:
            raise ServiceError("gcs serve was not started")
        self._process.send_signal(number)
