"""Arrivals in a simulated flight: at goals, pads and slots, and how late they are."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gcs.config.sections import OperationSettings
from gcs.model.state import Array, Mask
from gcs.simulation.record import STEADY_S, THROUGH_M, FlightRecord, rounded
from gcs.simulation.scenario import FormationFlight, GoalFlight
from gcs.simulation.shortest_ways import travel_time_s

TOTAL_SHARE, TOTAL_SPARE_S, SPARE_OF_MANY_S, MANY = 1.5, 10.0, 30.0, 200
"""`arrival.late_s` is the last arrival minus share times the longest straight-line time minus reserve."""

ROUND_SHARE, ROUND_SPARE_S = 2.0, 20.0
"""The same past boxes, of the longest of the shortest ways: some vehicles wait for their turn."""


AT_PAD_M: Final[float] = OperationSettings.model_fields["landing_site_spacing_m"].default
"""Farther than this from its pad, over the ground, a vehicle has not landed there: other pads are as near."""


@dataclass(frozen=True, slots=True)
class ArrivalFigures:
    """Arrivals, and their delay relative to straight flight at the limits.

    Of a flight that ends with a return landings at pads count, of other formations slots: with lost vehicles,
    or where the sphere stands.
    """

    arrived: int | None = None  # vehicles
    median_ratio: float | None = None  # time over that of straight flight
    worst_ratio: float | None = None
    total_s: float | None = None  # until the last arrival
    late_s: float | None = None  # of the last arrival; negative: early enough
    expected: int | None = None  # vehicles
    planning_s: float | None = None  # processor time of the collective return's plan


def arrival(record: FlightRecord) -> ArrivalFigures:
    return replace(_arrivals(record), planning_s=rounded(record.planning_s))


def _arrivals(record: FlightRecord) -> ArrivalFigures:
    flight, has_goals = record.scenario.flight, bool(np.isfinite(record.goal_m).all())
    if record.off_slot_m and not has_goals:
        return _in_slots(record) if record.way_s is None else _joined(record)
    if not has_goals:
        return ArrivalFigures()
    begin = int(np.searchsorted(record.time_s, record.changed_s - 1e-9))
    path_m = record.path_m[begin:]
    if isinstance(flight, GoalFlight):
        there = np.linalg.norm(path_m - record.goal_m, axis=2) < flight.arrived_m
    else:
        off_pad_m = np.linalg.norm((path_m - record.goal_m)[:, :, :2], axis=2)
        there = ~np.array(record.in_air[begin:]) & (off_pad_m < AT_PAD_M)
    return _reached(record, path_m[0], record.goal_m, there)


def _late_s(record: FlightRecord, took_s: Array, shortest_s: Array) -> float:
    """By how much the last of those (k,) that took so long was later than is allowed."""
    if record.way_s is not None:
        return float(took_s.max() - (ROUND_SHARE * shortest_s.max() + ROUND_SPARE_S))
    spare_s = TOTAL_SPARE_S if record.count <= MANY else SPARE_OF_MANY_S
    return float(took_s.max() - (TOTAL_SHARE * shortest_s.max() + spare_s))


def _ratios(record: FlightRecord, start_m: Array, place_m: Array, there: Mask) -> tuple[Array, Array, Array]:
    """(k,) times to first be `there` (ticks, n), over those of the shortest ways; both times (k,), s.

    Of the k expected vehicles, from (n, 3) to (n, 3). Infinite where one never was there.
    """
    control, rows = record.scenario.control, record.expected
    straight_s = travel_time_s(place_m - start_m, control.law.speed_m_s, control.safety.limits)[rows]
    if record.way_s is not None:
        straight_s = record.way_s[rows]
    first_s = there.argmax(axis=0) / record.scenario.world.tick_rate_hz
    took_s = np.where(there.any(axis=0), first_s, np.inf)[rows]
    return took_s / np.maximum(straight_s, 1e-9), took_s, straight_s


def _reached(record: FlightRecord, start_m: Array, place_m: Array, there: Mask) -> ArrivalFigures:
    """When each of the expected vehicles was first `there`, and whether in time; as `_ratios`."""
    if not record.expected.any():
        return ArrivalFigures(arrived=0, expected=0)
    ratio, took_s, shortest_s = _ratios(record, start_m, place_m, there)
    return ArrivalFigures(
        arrived=int(np.isfinite(took_s).sum()),
        expected=int(record.expected.sum()),
        median_ratio=rounded(float(np.median(ratio))),
        worst_ratio=rounded(float(ratio.max())),
        total_s=rounded(float(took_s.max())),
        late_s=rounded(_late_s(record, took_s, shortest_s)),
    )


def _in_slots(record: FlightRecord) -> ArrivalFigures:
    """Vehicles in formation, and the most of them at their slots at one moment of the last seconds.

    A formation that stands: not those off slots in closed space. On an orbit the last lap counts; in part of
    it the sphere passes lost vehicles.
    """
    flight, lasts_s = record.scenario.flight, STEADY_S
    if isinstance(flight, FormationFlight) and flight.orbit.radius_m:
        lasts_s = 2.0 * np.pi * flight.orbit.radius_m / flight.orbit.speed_m_s
    off_m = np.array(record.off_slot_m[-round(lasts_s * record.scenario.world.tick_rate_hz) :])
    record.expected = np.asarray(np.isfinite(off_m).all(axis=0))
    at_once = (off_m < THROUGH_M)[:, record.expected].sum(axis=1)
    counts = ArrivalFigures(arrived=int(at_once.max()), expected=int(record.expected.sum()))
    return _assembled(counts, record)


def _joined(record: FlightRecord) -> ArrivalFigures:
    """Of vehicles that join past boxes: when each first was within `THROUGH_M` of its slot, and in time."""
    begin = len(record.time_s) - len(record.off_slot_m)
    there = np.array(record.off_slot_m) < THROUGH_M
    return _reached(record, record.path_m[begin], record.slot_m, there)


def _assembled(figures: ArrivalFigures, record: FlightRecord) -> ArrivalFigures:
    """Add how long the vehicles took to come within `THROUGH_M` of the slots that they have at the end.

    Slots move while vehicles assemble; the straight line leads to where a vehicle's slot comes to rest.
    """
    if record.lost_rows or record.orbit_radius_m or record.changed_s or not record.expected.any():
        return figures
    place_m = record.slot_m
    there = np.linalg.norm(record.path_m - place_m, axis=2) < THROUGH_M
    ratio, took_s, _ = _ratios(record, record.path_m[0], place_m, there)
    return replace(
        figures,
        median_ratio=rounded(float(np.median(ratio))),
        worst_ratio=rounded(float(ratio.max())),
        total_s=rounded(float(took_s.max())),
    )
