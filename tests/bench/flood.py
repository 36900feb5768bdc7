"""200 calls of junk a second for 30 s while 20 vehicles fly: how late ticks come, how long a stop takes.

`make bench` prints it. Ticks' lateness is that of the last 2000, from take-off on; without junk it stands
in the rows of `links.py`.
"""

import asyncio
import tempfile
from pathlib import Path

from tests.bench.figures import at_most
from tests.support.machine import Pauses
from tests.system.test_emergency_flooded import COUNT, JUNK_PER_S, fly_and_flood

JUNK_S = 30.0
LATE_MS, WAIT_MS = 10.0, 100.0


def main() -> None:
    """Fly, flood and print."""
    with tempfile.TemporaryDirectory(prefix="gcs-flood-") as folder, Pauses() as machine:
        seen = asyncio.run(fly_and_flood(Path(folder), machine, JUNK_S))
    print(
        f"{COUNT} vehicles, {JUNK_PER_S:g} calls of junk a second for {JUNK_S:g} s, {seen.answered} answered:"
    )
    print(f"  tick lateness p99 {at_most(seen.late_p99_ms, LATE_MS)} ms")
    print(
        f"  the longest of {len(seen.waits_s)} emergency calls {at_most(max(seen.waits_s) * 1e3, WAIT_MS)} ms"
    )


if __name__ == "__main__":
    main()
