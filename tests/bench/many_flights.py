"""Flights of 20 vehicles, 60 s each, with arrays and figures, by `fly_many`: how many times real time.

`python -m tests.bench.many_flights [--flights 100] [--workers 2]`. The goal is 150 times on two cores that do
nothing else. Processor time does not depend on what else runs as much: it is printed beside.
"""

import argparse
import resource
import time

from gcs.simulation import Scenario, fly_many

GOAL = 150.0


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    began_s, flown_s, violations = time.perf_counter(), 0.0, 0
    for flight in fly_many(Scenario.load("assembly"), 20, range(asked.flights), workers=asked.workers):
        flown_s += flight.metrics.duration_s or 0.0
        violations += flight.metrics.separation.violations
    took_s = time.perf_counter() - began_s
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    used_s = used.ru_utime + used.ru_stime
    print(f"{asked.flights} flights in {took_s:.0f} s: {flown_s / took_s:.0f} x real time; goal {GOAL:.0f}")
    print(f"{used_s:.0f} s of processor time: {flown_s / used_s:.0f} x on each core; {violations} violations")


if __name__ == "__main__":
    main()
