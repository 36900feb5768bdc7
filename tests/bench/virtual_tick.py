"""What one virtual tick of four vehicles costs: `python -m tests.bench.virtual_tick`.

Processor time of this process, not the clock's: other processes do not count. The garbage collector skips
what is loaded, as in the tests.
"""

import argparse
import gc
import time

from gcs.model.lifecycle import ShowPhase
from gcs.testing.virtual_show import VirtualShow, fly, load_machine_code, show_config


def milliseconds(vehicles: int, flown_s: float) -> float:
    """Processor time of a tick in formation, in ms."""

    async def story(show: VirtualShow) -> float:
        await show.start()
        await show.reach(ShowPhase.RUNNING)
        began_s, first = time.process_time(), len(show.track.samples)
        await show.wait(flown_s)
        return 1e3 * (time.process_time() - began_s) / (len(show.track.samples) - first)

    return fly(story, show_config(vehicles))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--repeats", type=int, default=5)
    asked = parser.parse_args()
    load_machine_code()
    gc.collect()
    gc.freeze()
    figures = sorted(milliseconds(asked.vehicles, asked.seconds) for _ in range(asked.repeats))
    print(f"{figures[0]:.2f} ms a tick at least, {figures[len(figures) // 2]:.2f} in the median")
