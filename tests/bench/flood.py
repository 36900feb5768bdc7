"""200 calls of junk a second for 30 s while 20 vehicles fly: how late ticks come, how long a stop takes.

`make bench` prints it. Ticks' lateness is that of the last 2000, from take-off on; without junk it stands
in the rows of `links.py`.
"""

import asyncio
import tempfile
from pathlib import Path

from tests.support.machine import Pauses
from tests.system.test_emergency_flooded import COUNT, JUNK_PER_S, fly_and_flood

JUNK_S = 30.0
LATE_MS, WAIT_MS = 10.0, 100.0


def verdict(value: float, most: float) -> str:
    """The figure, and whether it is what must be reached."""
    return f"{value:.1f} ms (must: <= {most:g}: {'pass' if value <= most else 'MISS'})"


def main() -> None:
    """Fly, flood and print."""
    with tempfile.TemporaryDirectory(prefix="gcs-flood-") as folder, Pauses() as machine:
        seen = asyncio.run(fly_and_flood(Path(folder), machine, JUNK_S))
    print(
        f"{COUNT} vehicles, {JUNK_PER_S:g} calls of junk a second for {JUNK_S:g} s, {seen.answered} answered:"
    )
    print(f"  tick lateness p99 {verdict(seen.late_p99_ms, LATE_MS)}")
    print(f"  the longest of {len(seen.waits_s)} emergency calls {verdict(max(seen.waits_s) * 1e3, WAIT_MS)}")


if __name__ == "__main__":
    main()
