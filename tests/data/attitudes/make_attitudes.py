"""Attitudes and velocities of a recording, five times a second: `make_attitudes RECORDING.tlog OUT.csv.gz`.

Columns: time in s; roll, pitch and yaw in rad; velocity north, east and down in m/s; height above home in m.
"""

import gzip
import sys

from pymavlink import mavutil

EVERY_S = 0.2


def main(recording: str, out: str) -> None:
    link, moves, due_ms, lines = mavutil.mavlink_connection(recording), None, 0.0, []
    while (message := link.recv_match(type=["GLOBAL_POSITION_INT", "ATTITUDE"])) is not None:
        if message.get_srcComponent() != 1:
            continue
        if message.get_type() == "GLOBAL_POSITION_INT":
            moves = message.vx / 100, message.vy / 100, message.vz / 100, message.relative_alt / 1000
        elif moves is not None and message.time_boot_ms >= due_ms:
            due_ms = message.time_boot_ms + 1e3 * EVERY_S - 10.0
            row = message.time_boot_ms / 1e3, message.roll, message.pitch, message.yaw, *moves
            lines.append(",".join(f"{value:.4f}" for value in row))
    with gzip.open(out, "wt") as file:
        file.write("\n".join(lines))


if __name__ == "__main__":
    main(*sys.argv[1:])
