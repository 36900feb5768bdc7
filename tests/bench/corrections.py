"""Corrections of 1 kB/s to 100 vehicles on 4 links: how many arrive whole, and what setpoints lose by them.

`make bench` prints it, `python -m tests.bench.corrections` alone. Real UDP, fake vehicles that put the
fragments together; each link sends setpoints 20 times a second. The alternative is the same without a base.
"""

import asyncio
import logging
import os
import tempfile
import time
from pathlib import Path
from typing import Final

from tests.bench.figures import at_least
from tests.integration.test_link_corrections import (
    EACH,
    LASTS_S,
    LINKS,
    SECOND,
    Supplied,
    supply,
    whole_share,
)
from tests.support.machine import free_ports
from tests.support.processes import vehicles

WHOLE_MIN: Final = 0.99
RATE_MIN: Final = 0.99
"""Of the setpoint rate without corrections: what this machine repeats."""


def supplied(second: list[bytes]) -> tuple[Supplied, float]:
    """Supply 100 vehicles. Returns: what left, and the share of the messages that arrived whole."""
    with tempfile.TemporaryDirectory(prefix="gcs-corrections-") as folder:
        truth = Path(folder) / "truth.jsonl"
        with vehicles(LINKS * EACH, port := free_ports(LINKS * EACH), Path(folder)):
            found = asyncio.run(supply(port, free_ports(), second))
            time.sleep(0.3)  # the file is written 20 times a second
        return found, whole_share(truth, found.messages) if found.messages else 1.0


def main() -> None:
    """Measure without a base and with one, and print."""
    logging.disable(logging.WARNING)
    alone, _ = supplied([])
    found, whole = supplied(SECOND)
    rate = found.setpoints_hz / alone.setpoints_hz
    size = sum(map(len, SECOND))
    print(f"{LINKS * EACH} vehicles on {LINKS} links, {size} bytes/s of RTCM for {LASTS_S:g} s,", end=" ")
    print(f"load average {os.getloadavg()[0]:.1f}:")
    print(f"  complete messages, of {found.messages} for each vehicle: {at_least(whole, WHOLE_MIN, '.2%')}")
    print(
        f"  setpoints {found.setpoints_hz:.2f} a second and vehicle, {alone.setpoints_hz:.2f} without:",
        end=" ",
    )
    print(f"{at_least(rate, RATE_MIN, '.1%')}; {found.ticks_share:.1%} of what the ticks asked for")


if __name__ == "__main__":
    main()
