"""A drawing of 500 vehicles and 5 minutes: `gcs show import` by itself, and its upload to a running service.

`make bench` prints it; `python -m tests.bench.drawings 100 60` brings in another number of vehicles and
seconds. Wall time, processor time and memory at its greatest, of the process that reads the drawing.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from gcs.client import Client
from gcs.config import schema as configuration
from gcs.shows.formats import write_drawing
from tests.bench.figures import at_most
from tests.support.background import Background
from tests.support.drawn_shows import drawn_show
from tests.support.processes import supervised

SPACING_M, TIMES = 3.0, 3
SECONDS_MAX, MEMORY_MAX_MB = 3.0, 300.0
LOOK_S, WITHIN_S = 0.01, 120.0


def imported(drawing: Path, folder: Path) -> tuple[float, float]:
    """Import a drawing once. Returns: wall time and processor time in s."""
    command = [sys.executable, "-m", "gcs", "show", "import", str(drawing), "-o", str(folder / "a.yaml")]
    began_s = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    lasted_s = time.monotonic() - began_s
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} ended with {process.returncode}")
    for made in folder.glob("a.*"):
        made.unlink()
    return lasted_s, used.ru_utime + used.ru_stime


class Readers(Background):
    """Watches the processes of this machine that import a drawing, and notes their greatest memory."""

    def __init__(self) -> None:
        self.memory_mb = 0.0
        super().__init__("readers")

    def _live(self) -> None:
        while not self._stopped.wait(LOOK_S):
            for folder in Path("/proc").glob("[0-9]*"):
                with suppress(OSError):
                    if b"\0show\0import\0" in (folder / "cmdline").read_bytes():
                        self._note((folder / "status").read_text())

    def _note(self, status: str) -> None:
        for line in status.splitlines():
            if line.startswith("VmHWM:"):
                self.memory_mb = max(self.memory_mb, int(line.split()[1]) / 1024.0)


def uploaded(drawing: Path, folder: Path) -> tuple[list[float], float]:
    """Upload a drawing to a service on the ground. Returns: wall times in s, memory in MB."""
    raw = configuration.load(configuration.find("demo")).model_dump() | {
        "shows": {"folder": folder / "shows"}
    }
    (folder / "shows").mkdir()
    config = configuration.Config.model_validate(raw)
    times_s: list[float] = []
    with (
        supervised(config, folder / "service") as service,
        Client(service.url, timeout_s=WITHIN_S) as client,
        Readers() as readers,
    ):
        for number in range(TIMES):
            began_s = time.monotonic()
            client.shows.import_drawing(f"show{number}", drawing)
            times_s.append(time.monotonic() - began_s)
    return times_s, readers.memory_mb


def row(what: str, wall_s: Sequence[float], memory_mb: float, used_s: float | None = None) -> None:
    """Print one row; of several times the worst counts."""
    each = ", ".join(f"{one:.2f}" for one in wall_s)
    used = "" if used_s is None else f", processor {used_s:.2f} s"
    print(f"  {what:<12}{at_most(max(wall_s), SECONDS_MAX, '.2f')} s [{each}]{used},", end=" ")
    print(f"memory {at_most(memory_mb, MEMORY_MAX_MB, '.0f')} MB", flush=True)


def main(words: list[str]) -> None:
    """Make a drawing, bring it in both ways, and print."""
    vehicles, seconds = (int(word) for word in words) if words else (500, 300)
    with tempfile.TemporaryDirectory(prefix="gcs-drawings-") as name:
        folder = Path(name)
        drawing = folder / "drawing.skyc"
        write_drawing(drawn_show(vehicles, seconds, SPACING_M), drawing)
        size_kb = drawing.stat().st_size / 1024.0
        print(f"{vehicles} vehicles, {seconds} s, {size_kb:.0f} KB, load average {os.getloadavg()[0]:.1f}:")
        with Readers() as readers:
            walls_s, used_s = zip(*[imported(drawing, folder) for _ in range(TIMES)], strict=True)
        row("imported", walls_s, readers.memory_mb, max(used_s))
        row("uploaded", *uploaded(drawing, folder))


if __name__ == "__main__":
    main(sys.argv[1:])
