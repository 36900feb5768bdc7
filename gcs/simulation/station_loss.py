"""Predicts what vehicles of a rehearsed drawn show do by themselves if the station is lost in a drawn part.

No flight: from where the rehearsal had the vehicles, each flies on and stops as its autopilot does, then all
execute one action. Timing of the paths home is not relied on, as before a start.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gcs.config.sections import OperationSettings
from gcs.links.autopilots import AUTOPILOTS, Autopilot
from gcs.model.setpoint_loss import FleetWithoutSetpoints, WithoutSetpoints
from gcs.planning.loss_in_motion import clashes_in_motion
from gcs.planning.setpoint_loss import Action, Clash
from gcs.simulation.rehearsal import Rehearsal

SAMPLED_S: Final = 3.0
"""Of the show's time, between two moments at which the station may be lost."""

MOMENTS_MAX: Final = 100
"""In long shows they are farther apart."""

PREDICTED: Final[dict[Action, str]] = {"hold": "hold", "return": "return", "land": "land or descend"}
"""Actions, and how they are named: vehicles that land and those that descend have the same paths."""


@dataclass(frozen=True, slots=True)
class StationLoss:
    """What one action of the autopilots would do to the separation, over all sampled moments."""

    action: Action  # "land" stands for "descend" as well
    moments: int  # sampled
    unsafe: int  # of these: some pair would come below the floor
    pairs: int  # different ones
    closest: tuple[int, int] | None = None  # vehicles of the show, from 1; None: all would stay apart
    sideways_m: float | None = None  # their distance, seen from above
    at_s: float | None = None  # time of the show at which the station is lost
    cue: str = ""


def station_loss(flight: Rehearsal) -> tuple[StationLoss, ...]:
    """Return the prediction for each action; empty without drawn parts."""
    ticks = _sampled(flight)
    found = [_clashes(flight, tick) for tick in ticks]
    return tuple(_over_all(flight, action, ticks, found) for action in PREDICTED) if ticks else ()


def _sampled(flight: Rehearsal) -> list[int]:
    """Return ticks in which a drawing led."""
    apart_s = max(SAMPLED_S, flight.timeline.duration_s / MOMENTS_MAX)
    due_s, ticks = 0.0, list[int]()
    for tick, show_s in enumerate(flight.show_s):
        ended = flight.ended_s is not None and flight.record.time_s[tick] >= flight.ended_s
        if not ended and show_s >= due_s and flight.timeline.drawn_s(show_s) is not None:
            ticks.append(tick)
            due_s = show_s + apart_s
    return ticks


def _clashes(flight: Rehearsal, tick: int) -> dict[Action, list[Clash]]:
    """Return the pairs of each action, by row of the fleet, if the station were lost in this tick."""
    record, world = flight.record, flight.scenario.world
    rows = np.flatnonzero(record.formed[tick])
    before, after = max(tick - 1, 0), min(tick + 1, len(record.position_m) - 1)
    moved_m = record.position_m[after][rows].astype(np.float64) - record.position_m[before][rows]
    profiles = [AUTOPILOTS[world.autopilot_of(row)] for row in rows.tolist()]
    found = clashes_in_motion(
        record.position_m[tick][rows].astype(np.float64),
        moved_m * (world.tick_rate_hz / (after - before)),
        flight.world.home_m[rows],
        tuple(PREDICTED),
        FleetWithoutSetpoints(_alone(profiles)),
        floor=flight.floor,
        return_height_m=flight.world.return_height_m[rows],
    )
    return {
        action: [Clash(int(rows[one.first]), int(rows[one.second]), one.sideways_m) for one in pairs]
        for action, pairs in found.items()
    }


def _alone(profiles: Sequence[Autopilot]) -> list[WithoutSetpoints]:
    """Return what each vehicle does; all fly on as long as any may, since a start demands one time."""
    loss_s = OperationSettings().setpoint_loss_s
    unread = [each.without_setpoints("hold", loss_s, {}) for each in profiles]
    longest_s = max((each.flies_on_s for each in unread), default=loss_s)
    return [replace(each, flies_on_s=longest_s) for each in unread]


def _over_all(
    flight: Rehearsal, action: Action, ticks: Sequence[int], found: Sequence[dict[Action, list[Clash]]]
) -> StationLoss:
    unsafe = [(at[action], tick) for at, tick in zip(found, ticks, strict=True) if at[action]]
    if not unsafe:
        return StationLoss(action, len(ticks), 0, 0)
    worst, tick = min(unsafe, key=lambda one: one[0][0].sideways_m)
    at_s = flight.show_s[tick]
    return StationLoss(
        action,
        len(ticks),
        len(unsafe),
        len({(clash.first, clash.second) for clashes, _ in unsafe for clash in clashes}),
        (worst[0].first + 1, worst[0].second + 1),
        round(worst[0].sideways_m, 2),
        round(at_s, 2),
        flight.timeline.cue_at(at_s).cue.cue,
    )


def described(losses: Sequence[StationLoss]) -> list[str]:
    """Return the prediction as lines of text."""
    lines = ["  if the station were lost in a drawn part, the autopilots' own action:"] if losses else []
    for one in losses:
        name = PREDICTED[one.action]
        if one.closest is None:
            lines.append(f"    {name}: all stay apart, at each of {one.moments} moments")
            continue
        first, second = one.closest
        pairs = f"{one.pairs} pair{'s' if one.pairs > 1 else ''} below the floor"
        closest = (
            f"{first} and {second} {one.sideways_m:.2f} m, seen from above, at {one.at_s:.0f} s ('{one.cue}')"
        )
        lines.append(f"    {name}: {pairs}, at {one.unsafe} of {one.moments} moments; {closest}")
    return lines
