"""Make steps.json.gz from the step_*.csv.xz that were recorded beside an ArduCopter.

    python make_steps.py folder steps.json.gz

For each step, by its name and WPNAV_ACCEL: `commands`, the setpoints as [time_s, north, east, down] in m/s,
and `velocity_m_s`, the measured one as [time_s, north, east, down], ten times a second.
"""

from __future__ import annotations

import csv
import gzip
import json
import lzma
import sys
from pathlib import Path
from typing import Any

EVERY = 5  # of 50 samples a second
COMMANDED, MEASURED = slice(1, 4), slice(4, 7)


def step_of(rows: list[list[float]]) -> dict[str, Any]:
    commands: list[list[float]] = []
    for row in rows:
        if not commands or commands[-1][1:] != row[COMMANDED]:
            commands.append([round(row[0], 2), *row[COMMANDED]])
    velocity = [[round(row[0], 2), *(round(each, 2) for each in row[MEASURED])] for row in rows[::EVERY]]
    return {"commands": commands, "velocity_m_s": velocity}


def main() -> None:
    steps = {}
    for path in sorted(Path(sys.argv[1]).glob("step_*.csv.xz")):
        name = path.name.removeprefix("step_").removesuffix(".csv.xz")
        if name.startswith("yaw"):
            continue
        with lzma.open(path, "rt") as file:
            steps[name] = step_of([[float(each) for each in row] for row in list(csv.reader(file))[1:]])
    raw = json.dumps(steps, separators=(",", ":")).encode()
    Path(sys.argv[2]).write_bytes(gzip.compress(raw, 9, mtime=0))


if __name__ == "__main__":
    main()
