"""Flies a written show as a scenario, for the rows of docs/flight-quality.md."""

from dataclasses import asdict

import numpy as np

from gcs.shows import find, load
from gcs.simulation.metrics import rounded, separation, ticks_ms
from gcs.simulation.record import penetrations_and_clearance_m
from gcs.simulation.rehearsal import Rehearsal
from gcs.simulation.scenario import Scenario, ShowFlight
from gcs.simulation.verdict import LAG_REPORTED_M, lags


def flown_show(scenario: Scenario, flight: ShowFlight, seed: int) -> dict[str, object]:
    """Fly the show in the scenario's world, and return its figures.

    Raises: ConfigError when there is no such show, or it is not good.
    """
    scenario = scenario.in_world_of(seed)
    run = Rehearsal(load(find(flight.show)), scenario.world, seed, adversity=flight)
    record, count = run.fly(), len(run.task)
    duration_s = record.time_s[-1] + 1.0 / scenario.world.tick_rate_hz
    ours = ~run.losses.rows
    landed = int(np.count_nonzero(~record.in_air[-1] & ours))
    figures: dict[str, object] = {
        "scenario": scenario.name,
        "vehicles": count,
        "seed": seed,
        "duration_s": rounded(duration_s),
        "realtime_factor": rounded(duration_s / max(record.busy_s, 1e-9), 1),
        "separation": separation(record),
        "arrival": {"arrived": landed, "expected": int(np.count_nonzero(ours))},
        "track": {
            "rms_m": rounded(run.errors.fleet_rms_m),
            "worst_rms_m": rounded(float(run.errors.rms_m.max())),
            "max_m": rounded(float(run.errors.max_m.max())),
            "lags": [asdict(lag) for lag in lags(run) if lag.max_m >= LAG_REPORTED_M],
        },
        "tick": ticks_ms(record),
    }
    if any(record.boxes):
        penetrations, clearance_m = penetrations_and_clearance_m(record)
        figures["obstacles"] = {"penetrations": penetrations, "minimum_clearance_m": rounded(clearance_m)}
    return figures
