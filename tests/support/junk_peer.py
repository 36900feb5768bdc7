"""A stranger on the bus of a site without TLS: `python -m tests.support.junk_peer HOST PORT STATION ...`.

It connects to one endpoint as a plain Zenoh session, and publishes 1,000 messages a second: under the keys
of the named stations, under keys of no station, and too large ones. It prints a line once it has begun.
"""

import json
import random
import sys
import time

import zenoh

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
    keys = [f"gcs/{name}/{topic}" for name in stations for topic in TOPICS]
    keys += ["gcs/stranger/states", "gcs/states", "elsewhere/states", f"gcs/{stations[0]}/states/more"]
    sizes = (0, 1, 7, 100, 1000)
    session = zenoh.open(config)
    time.sleep(0.5)
    print("begun", flush=True)  # noqa: T201 - its output
    due_s, sent = time.monotonic(), 0
    while True:
        for _ in range(BURST):
            sent += 1
            size = TOO_LARGE if sent % PER_S == 0 else samples.choice(sizes)
            session.put(samples.choice(keys), samples.randbytes(size))
        due_s += BURST / PER_S
        time.sleep(max(0.0, due_s - time.monotonic()))


if __name__ == "__main__":
    main(*sys.argv[1:])
