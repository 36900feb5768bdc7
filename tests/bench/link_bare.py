"""The datagrams of a fleet through bare sockets, in C, for `links.py` to compare the service with.

The least that any program needs for them: one system call reads or sends many, and nothing looks inside. What
leaves is the setpoints that the service's own codec makes.
"""

import subprocess
import tempfile
from math import nan
from pathlib import Path
from shutil import which

import numpy as np

from gcs.mavlink import codec
from gcs.mavlink.framing import SET_POSITION_TARGET_LOCAL_NED
from gcs.mavlink.setpoints import setpoint_messages
from tests.bench.link_measures import (
    EACH,
    FIRST_PORT,
    MEASURED_S,
    WARM_UP_S,
    CannotError,
    Cost,
    Fleet,
    namespaces,
)

SOURCE = Path(__file__).with_name("bare_sockets.c")


def bare_sockets(fleet: Fleet, count: int, rate_hz: float) -> Cost:
    """Fly them with setpoints that are always the same. Raises: CannotError without a C compiler."""
    compiler = which("gcc") or which("cc")
    if compiler is None:
        raise CannotError("needs a C compiler, gcc or cc")
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "bare_sockets"
        subprocess.run([compiler, "-O2", "-o", program, SOURCE], check=True)
        shape = FIRST_PORT, namespaces(count), rate_hz, WARM_UP_S, MEASURED_S
        command = [str(program), *map(str, shape)]
        done = subprocess.run(command, input=_frames(min(EACH, count)), stdout=subprocess.PIPE, check=True)
    fleet.end()
    wall_s, busy_s, sent, _ = map(float, done.stdout.split())
    return Cost(100 * busy_s / wall_s, nan, sent / wall_s)


def _frames(count: int) -> bytes:
    """A setpoint for each vehicle of a namespace, its length before it."""
    still = np.full((count, 3), 0.1)
    messages = setpoint_messages(np.arange(1, count + 1), still, still[:, 0], time_s=1.0)
    frames = codec.encode(SET_POSITION_TARGET_LOCAL_NED, messages, np.zeros(count, np.uint8))
    lengths = frames.length.tolist()
    return b"".join(
        bytes([length]) + data[:length].tobytes() for data, length in zip(frames.data, lengths, strict=True)
    )
