"""Flies a written show as a scenario, for the rows of docs/flight-quality.md."""

import numpy as np

from gcs.shows import find, load
from gcs.simulation.metrics import rounded, separation, ticks_ms
from gcs.simulation.rehearsal import Rehearsal
from gcs.simulation.scenario import Scenario, ShowFlight


def flown_show(scenario: Scenario, flight: ShowFlight, seed: int) -> dict[str, object]:
    """Fly the show in the scenario's world, and return its figures.

    Raises: ConfigError when there is no such show, or it is not good.
    """
    scenario = scenario.in_world_of(seed)
    run = Rehearsal(load(find(flight.show)), scenario.world, seed)
    record, count = run.fly(), len(run.task)
    duration_s = record.time_s[-1] + 1.0 / scenario.world.tick_rate_hz
    landed = int(np.count_nonzero(~record.in_air[-1]))
    return {
        "scenario": scenario.name,
        "vehicles": count,
        "seed": seed,
        "duration_s": rounded(duration_s),
        "realtime_factor": rounded(duration_s / max(record.busy_s, 1e-9), 1),
        "separation": separation(record),
        "arrival": {"arrived": landed, "expected": count},
        "track": {
            "rms_m": rounded(run.errors.fleet_rms_m),
            "worst_rms_m": rounded(float(run.errors.rms_m.max())),
            "max_m": rounded(float(run.errors.max_m.max())),
        },
        "tick": ticks_ms(record),
    }
