"""Predicts what vehicles of a rehearsed drawn show do by themselves if the station is lost in a drawn part.

No flight: from where the rehearsal had the vehicles, each flies on and stops as its autopilot does, then all
execute one action. Timing of the paths home is not relied on, as before a start.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from gcs.config.sections import OperationSettings
from gcs.links.autopilots import AUTOPILOTS, Autopilot
from gcs.model.setpoint_loss import FleetWithoutSetpoints, WithoutSetpoints
from gcs.model.state import TINY, Array
from gcs.planning.setpoint_loss import NOTICED_WITHIN_S, Action, Clash, clashes
from gcs.safety.floor import Floor
from gcs.simulation.rehearsal import Rehearsal

SAMPLED_S: Final = 3.0
"""Of the show's time, between two moments at which the station may be lost."""

MOMENTS_MAX: Final = 100
"""In long shows they are farther apart."""

PREDICTED: Final[dict[Action, str]] = {"hold": "hold", "return": "return", "land": "land or descend"}
"""Actions, and how they are named: vehicles that land and those that descend have the same paths."""


@dataclass(frozen=True, slots=True)
class ControlLoss:
    """What one action of the autopilots would do to the separation, over all sampled moments."""

    action: Action  # "land" stands for "descend" as well
    moments: int  # sampled
    unsafe: int  # of these: some pair would come below the floor
    pairs: int  # different ones
    closest: tuple[int, int] | None = None  # vehicles of the show, from 1; None: all would stay apart
    sideways_m: float | None = None  # their distance, seen from above
    at_s: float | None = None  # time of the show at which the station is lost
    cue: str = ""


def control_loss(flight: Rehearsal) -> tuple[ControlLoss, ...]:
    """Return the prediction for each action; empty without drawn parts."""
    ticks = sampled(flight)
    clashes_of = [_clashes(flight, tick) for tick in ticks]
    return tuple(_over_all(flight, action, ticks, clashes_of) for action in PREDICTED) if ticks else ()


def sampled(flight: Rehearsal) -> list[int]:
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
    pairs_of = clashes_in_motion(
        record.position_m[tick][rows].astype(np.float64),
        moved_m * (world.tick_rate_hz / (after - before)),
        flight.world.home_m[rows],
        tuple(PREDICTED),
        FleetWithoutSetpoints(_alone(profiles)),
        floor=flight.floor,
        return_height_m=flight.world.return_height_m[rows],
    )
    return {
        action: [Clash(int(rows[clash.first]), int(rows[clash.second]), clash.sideways_m) for clash in pairs]
        for action, pairs in pairs_of.items()
    }


def _alone(profiles: Sequence[Autopilot]) -> list[WithoutSetpoints]:
    """Return what each vehicle does; all fly on as long as any may, since a start demands one time."""
    loss_s = OperationSettings().setpoint_loss_s
    unread = [each.without_setpoints("hold", loss_s, {}) for each in profiles]
    longest_s = max((each.flies_on_s for each in unread), default=loss_s)
    return [replace(each, flies_on_s=longest_s) for each in unread]


def _over_all(
    flight: Rehearsal, action: Action, ticks: Sequence[int], clashes_of: Sequence[dict[Action, list[Clash]]]
) -> ControlLoss:
    unsafe = [(at[action], tick) for at, tick in zip(clashes_of, ticks, strict=True) if at[action]]
    if not unsafe:
        return ControlLoss(action, len(ticks), 0, 0)
    worst, tick = min(unsafe, key=lambda unsafe_at: unsafe_at[0][0].sideways_m)
    at_s = flight.show_s[tick]
    return ControlLoss(
        action,
        len(ticks),
        len(unsafe),
        len({(clash.first, clash.second) for clashes, _ in unsafe for clash in clashes}),
        (worst[0].first + 1, worst[0].second + 1),
        round(worst[0].sideways_m, 2),
        round(at_s, 2),
        flight.timeline.cue_at(at_s).cue.cue,
    )


def described(losses: Sequence[ControlLoss]) -> list[str]:
    """Return the prediction as lines of text."""
    lines = ["  if the station were lost in a drawn part, the autopilots' own action:"] if losses else []
    for loss in losses:
        name = PREDICTED[loss.action]
        if loss.closest is None:
            lines.append(f"    {name}: all stay apart, at each of {loss.moments} moments")
            continue
        first, second = loss.closest
        pairs = f"{loss.pairs} pair{'s' if loss.pairs > 1 else ''} below the floor"
        away = f"{loss.sideways_m:.2f} m, seen from above"
        closest = f"{first} and {second} {away}, at {loss.at_s:.0f} s ('{loss.cue}')"
        lines.append(f"    {name}: {pairs}, at {loss.unsafe} of {loss.moments} moments; {closest}")
    return lines


def clashes_in_motion(
    position_m: Array,
    velocity_m_s: Array,
    home_m: Array,
    actions: Sequence[Action],
    alone: FleetWithoutSetpoints,
    *,
    floor: Floor,
    return_height_m: Array,
) -> dict[Action, list[Clash]]:
    """Return for each action all pairs that would come below the floor, closest seen from above first.

    Args:
        position_m: (n, 3) positions at the loss, show frame.
        velocity_m_s: (n, 3) velocities then.
        home_m: (n, 3) each vehicle's own start.
        actions: each is executed by all vehicles, once they have stopped.
        alone: how long each flies on, and how it stops.
        floor: without its margin and uncertainty: positions are taken as they are.
        return_height_m: (n,) RTL_RETURN_ALT, above home.
    """
    count = len(position_m)
    drift_s = alone.flies_on_s + alone.stop_s(np.arange(count), velocity_m_s)
    stops_m = position_m + velocity_m_s * drift_s[:, None]
    stopping = _while_stopping(position_m, velocity_m_s, drift_s, floor)

    def found_by(action: Action) -> list[Clash]:
        then = clashes(
            stops_m,
            home_m,
            action,
            floor=floor,
            uncertainty_m=np.zeros(count),
            speed_m_s=0.0,
            return_height_m=return_height_m,
        )
        nearest: dict[tuple[int, int], Clash] = {}
        for clash in sorted([*stopping, *then], key=lambda clash: clash.sideways_m):
            nearest.setdefault((clash.first, clash.second), clash)
        return list(nearest.values())

    return {action: found_by(action) for action in actions}


def _while_stopping(position_m: Array, velocity_m_s: Array, drift_s: Array, floor: Floor) -> list[Clash]:
    """Return the pairs that meet until both have stopped, also if one stops `NOTICED_WITHIN_S` later."""
    first, second = np.triu_indices(len(position_m), 1)
    reach_m = np.linalg.norm(velocity_m_s, axis=1) * (drift_s.max(initial=0.0) + NOTICED_WITHIN_S)
    begin_m = position_m[first] - position_m[second]
    meet = (
        np.linalg.norm(begin_m * floor.scale, axis=1) < floor.horizontal_m + reach_m[first] + reach_m[second]
    )
    first, second, begin_m = first[meet], second[meet], begin_m[meet]
    together_s = np.minimum(drift_s[first], drift_s[second])
    part_m = begin_m + (velocity_m_s[first] - velocity_m_s[second]) * together_s[:, None]
    first_on_m = velocity_m_s[first] * (drift_s[first] - together_s + NOTICED_WITHIN_S)[:, None]
    second_on_m = velocity_m_s[second] * (drift_s[second] - together_s + NOTICED_WITHIN_S)[:, None]
    clashes: list[Clash] = []
    for path in ((begin_m, part_m, part_m + first_on_m), (part_m, part_m - second_on_m)):
        for from_m, to_m in pairwise(path):
            near_m = _nearest_m(from_m * floor.scale, to_m * floor.scale)
            inside = np.flatnonzero(np.linalg.norm(near_m, axis=1) < floor.horizontal_m)
            for at in inside.tolist():
                sideways_m = float(np.hypot(near_m[at, 0], near_m[at, 1]))
                clashes.append(Clash(int(first[at]), int(second[at]), sideways_m))
    return clashes


def _nearest_m(from_m: Array, to_m: Array) -> Array:
    """(k, 3) The point nearest to the origin on each straight way between (k, 3) points."""
    along_m = to_m - from_m
    share = -(from_m * along_m).sum(axis=1) / np.maximum((along_m**2).sum(axis=1), TINY)
    return np.asarray(from_m + np.clip(share, 0.0, 1.0)[:, None] * along_m)
