"""Figures of a written show that was flown as a scenario, for the rows of docs/flight-quality.md."""

import numpy as np

from gcs.simulation.arrivals import ArrivalFigures
from gcs.simulation.metrics import FlightMetrics, ObstacleFigures, TrackFigures, common
from gcs.simulation.record import penetrations_and_clearance_m, rounded
from gcs.simulation.rehearsal import Rehearsal
from gcs.simulation.scenario import Scenario
from gcs.simulation.site_figures import figures as site_figures
from gcs.simulation.verdict import LAG_REPORTED_M, lags


def show_metrics(scenario: Scenario, run: Rehearsal) -> FlightMetrics:
    """All figures of a rehearsal that was flown in the world of `scenario`."""
    record, ours = run.record, ~run.losses.rows
    landed = int(np.count_nonzero(~record.in_air[-1] & ours))
    passed_boxes = None
    if any(record.boxes):
        penetrations, clearance_m = penetrations_and_clearance_m(record)
        passed_boxes = ObstacleFigures(penetrations=penetrations, minimum_clearance_m=rounded(clearance_m))
    return FlightMetrics(
        **common(record, scenario.name),
        arrival=ArrivalFigures(arrived=landed, expected=int(np.count_nonzero(ours))),
        track=TrackFigures(
            rounded(run.errors.fleet_rms_m),
            rounded(run.own_errors.fleet_rms_m),
            rounded(float(run.own_errors.max_m.max())),
            rounded(float(run.errors.rms_m.max())),
            rounded(float(run.errors.max_m.max())),
            tuple(lag for lag in lags(run) if lag.max_m >= LAG_REPORTED_M),
        ),
        obstacles=passed_boxes,
        site=site_figures(record),
    )
