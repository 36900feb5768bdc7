"""A stranger on the bus of a site without TLS: `python -m tests.support.junk_peer HOST PORT STATION ...`.

It connects to one endpoint as a plain Zenoh session, and publishes 1,000 messages a second, all of a second
under one key: that of each named station in turn, and keys of no station. Half of them are bundles of one
message of the site's topics, which is junk; the others are junk as a whole, some too large. It prints a line
once it has begun.
"""

import json
import random
import sys
import time

import zenoh

from gcs.bus.bundles import bundles
from gcs.bus.zenoh_bus import BUNDLES
from gcs.bus.zenoh_config import ROOT

PER_S, BURST = 1000, 50
TOPICS = ("states", "formation", "plan", "homes", "info", "slots.south", "letters.north", "return.north.0")
TOO_LARGE = 61_000


def main(host: str, port: str, *stations: str) -> None:
    """Publish until it is killed."""
    config = zenoh.Config()
    values = {
        "mode": "peer",
        "connect/endpoints": [f"tcp/{host}:{port}"],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
    }
    for name, value in values.items():
        config.insert_json5(name, json.dumps(value))
    samples = random.Random(3)
    keys = [f"{ROOT}/{name}/{BUNDLES}" for name in (*stations, "stranger")]
    keys += [f"{ROOT}/{BUNDLES}", f"elsewhere/{BUNDLES}", f"{ROOT}/{stations[0]}/{BUNDLES}/more"]
    sizes = (0, 1, 7, 100, 1000)
    session = zenoh.open(config)
    time.sleep(0.5)
    print("begun", flush=True)  # noqa: T201 - its output
    due_s, sent = time.monotonic(), 0
    while True:
        for _ in range(BURST):
            sent += 1
            size = TOO_LARGE if sent % PER_S == 0 else samples.choice(sizes)
            junk = samples.randbytes(size)
            if sent % 2:
                (junk,) = bundles({samples.choice(TOPICS): junk})
            session.put(keys[sent // PER_S % len(keys)], junk)
        due_s += BURST / PER_S
        time.sleep(max(0.0, due_s - time.monotonic()))


if __name__ == "__main__":
    main(*sys.argv[1:])
