"""What other stations report of their vehicles, one row each, and which station flies each of them."""

from functools import cache
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.estimation.fleet_state import FORWARD_MAX_S
from gcs.model.jit import kernel
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Array, Mask
from gcs.model.vehicle_columns import SENT
from gcs.stations.messages import (
    AIRBORNE,
    ARMED,
    COMMANDED,
    FORMED,
    OWNED,
    PHASE_CODE,
    READY,
    SLOT_STAYS,
    UNKNOWN,
    UNKNOWN_STEPS,
    BatchHead,
    Codes,
    SlotsMessage,
    StateBatch,
    decode_batch,
)

Rows: TypeAlias = NDArray[np.intp]

NO_STATION: Final = -1
"""Number of the station of a vehicle that none flies."""

KILLED: Final = PHASE_CODE[Phase.KILLED]
WITHOUT_LINK: Final = (PHASE_CODE[Phase.LOST], KILLED)
"""Phases of vehicles that their own station does not command: others keep their space clear."""

HAS_NO_LINK: Final = np.isin(np.arange(256), WITHOUT_LINK)
"""By the number of a phase."""

CHANGES_M_S2, STRAYS_S = 3.0, 0.25
"""A vehicle strays from where its report leads by such a change of its velocity, for so long at most."""


class ReportedVehicles(NamedTuple):
    """Columns of k vehicles, show frame, changed in place. NaN, -inf: not known."""

    owner: Rows  # number of the station that flies each, NO_STATION: none is known
    epochs: Codes  # of that ownership
    position_m: Array  # (k, 3) of the newest batch that had one
    velocity_m_s: Array  # (k, 3)
    unfiltered_m_s: Array  # (k, 3) what their station's safety filter was given, NaN: not commanded
    desired_m_s: Array  # (k, 3) what it made of that, NaN: not commanded
    setpoint_m_s: Array  # (k, 3) for them, without the trim
    uncertainty_m: Array
    measured_s: Array  # when the position was measured
    made_s: Array  # when the batch was made
    phases: Codes  # places in PHASES
    modes: Codes  # places in MODES
    airborne: Mask
    formed: Mask
    slot_stays: Mask
    armed: Mask
    ready: Mask
    yaw_rad: Array
    numbers: Codes  # (k, ...) steps as in `messages.ROW`

    @staticmethod
    def unknown(count: int) -> "ReportedVehicles":
        """Nothing received of so many vehicles."""

        def no_number() -> Array:
            return np.full(count, np.nan)

        def no_vector() -> Array:
            return np.full((count, 3), np.nan)

        def never() -> Array:
            return np.full(count, -np.inf)

        def none() -> Mask:
            return np.zeros(count, np.bool_)

        return ReportedVehicles(
            owner=np.full(count, NO_STATION),
            epochs=np.zeros(count, np.uint8),
            position_m=no_vector(),
            velocity_m_s=no_vector(),
            unfiltered_m_s=no_vector(),
            desired_m_s=no_vector(),
            setpoint_m_s=no_vector(),
            uncertainty_m=np.zeros(count),
            measured_s=never(),
            made_s=never(),
            phases=np.full(count, PHASE_CODE[Phase.OFFLINE], np.uint8),
            modes=np.zeros(count, np.uint8),
            airborne=none(),
            formed=none(),
            slot_stays=none(),
            armed=none(),
            ready=none(),
            yaw_rad=no_number(),
            numbers=np.full((count, len(SENT)), UNKNOWN_STEPS, np.uint8),
        )


@kernel
def take(reported: ReportedVehicles, rows: Rows, wire: NDArray[np.void], station: int, made_s: float) -> None:
    """Take what one batch reports of the vehicles that its station flies from now on.

    A station claims a vehicle with a higher epoch of its ownership, or one that no other flies. Vehicles that
    it does not own any more are given up.

    Args:
        reported: of k vehicles, changed.
        rows: (m,) of the batch's vehicles among the k.
        wire: (m,) of `messages.ROW`.
        station: number of the batch's station.
        made_s: when the batch was made, own clock.
    """
    position_m, motion_cm_s, flags = wire["position_m"], wire["motion_cm_s"], wire["flags"]
    numbers = wire["numbers"]
    for j in range(len(rows)):
        row, owned, epoch = rows[j], flags[j] & OWNED != 0, wire[j].epoch
        is_owner, before = reported.owner[row] == station, reported.epochs[row]
        unclaimed = is_owner or reported.owner[row] == NO_STATION
        if not owned or not (epoch > before or (epoch == before and unclaimed)):
            if is_owner and not owned:
                reported.owner[row] = NO_STATION
            continue
        reported.owner[row], reported.epochs[row] = station, epoch
        age_ms = wire[j].age_ms
        is_known = age_ms != UNKNOWN
        reported.made_s[row] = made_s
        reported.measured_s[row] = made_s - age_ms / 1000.0 if is_known else -np.inf
        reported.uncertainty_m[row] = wire[j].uncertainty_cm / 100.0
        reported.phases[row], reported.modes[row] = wire[j].phase, wire[j].mode
        reported.airborne[row], reported.formed[row] = flags[j] & AIRBORNE != 0, flags[j] & FORMED != 0
        reported.slot_stays[row] = flags[j] & SLOT_STAYS != 0
        reported.armed[row], reported.ready[row] = flags[j] & ARMED != 0, flags[j] & READY != 0
        reported.yaw_rad[row] = wire[j].yaw / 1e4
        for k in range(reported.numbers.shape[1]):
            reported.numbers[row, k] = numbers[j, k]
        x_m, y_m, z_m = position_m[j, 0], position_m[j, 1], position_m[j, 2]
        if not is_known or not (np.isfinite(x_m) and np.isfinite(y_m) and np.isfinite(z_m)):
            continue
        reported.position_m[row, 0], reported.position_m[row, 1], reported.position_m[row, 2] = x_m, y_m, z_m
        commanded = flags[j] & COMMANDED != 0
        for k in range(3):
            reported.velocity_m_s[row, k] = motion_cm_s[j, k] / 100.0
            reported.unfiltered_m_s[row, k] = motion_cm_s[j, 3 + k] / 100.0 if commanded else np.nan
            reported.desired_m_s[row, k] = motion_cm_s[j, 6 + k] / 100.0 if commanded else np.nan
            reported.setpoint_m_s[row, k] = motion_cm_s[j, 9 + k] / 100.0 if commanded else np.nan


@kernel
def at_time(
    reported: ReportedVehicles, mine: Mask, here: Mask, shares: Mask, now_s: float, age_max_s: float
) -> tuple[Array, Array, Array, Array, Mask, Mask, Mask]:
    """The vehicles at the time of a tick.

    Args:
        reported: of k vehicles.
        mine: (k,) those that this station flies itself: without position, neither in the air nor formed.
        here: (stations + 1,) whether each station is received; the last: False.
        shares: (stations + 1,) whether each also receives this one, both just now; the last: False.
        now_s: of the tick, own clock.
        age_max_s: a vehicle with an older position is not commanded by its station.

    Returns: (k, 3) positions and (k,) their uncertainty, (k, 3) velocities before and (k, 3) after the safety
        filter, NaN where not `shares`, (k,) in the air, (k,) in formation, and (k,)
        without control: silent in the air, or of a phase without a link.
    """
    k = len(reported.owner)
    position_m, uncertainty_m = np.empty((k, 3)), np.empty(k)
    unfiltered_m_s, filtered_m_s = np.full((k, 3), np.nan), np.full((k, 3), np.nan)
    airborne, formed, without = np.empty(k, np.bool_), np.empty(k, np.bool_), np.empty(k, np.bool_)
    for i in range(k):
        silent = reported.airborne[i] and now_s - reported.measured_s[i] > age_max_s
        is_known = np.isfinite(reported.position_m[i, 0]) and not mine[i]
        without[i] = is_known and (silent or HAS_NO_LINK[reported.phases[i]])
        forward_s = min(max(now_s - reported.made_s[i], 0.0), FORWARD_MAX_S)
        strays_m = 0.5 * CHANGES_M_S2 * min(forward_s, STRAYS_S) ** 2
        uncertainty_m[i] = np.sqrt(reported.uncertainty_m[i] ** 2 + strays_m**2)
        for axis in range(3):
            moved_m = forward_s * reported.velocity_m_s[i, axis]
            position_m[i, axis] = np.nan if mine[i] else reported.position_m[i, axis] + moved_m
        age_s = now_s - reported.measured_s[i]
        airborne[i] = reported.airborne[i] and not mine[i]
        formed[i] = reported.formed[i] and age_s <= age_max_s and here[reported.owner[i]] and not mine[i]
        if age_s <= age_max_s and shares[reported.owner[i]] and not mine[i]:
            for axis in range(3):
                unfiltered_m_s[i, axis] = reported.unfiltered_m_s[i, axis]
                filtered_m_s[i, axis] = reported.desired_m_s[i, axis]
    return position_m, uncertainty_m, unfiltered_m_s, filtered_m_s, airborne, formed, without


@cache
def warm_up() -> None:
    """Compile or load every kernel of the batches and slots, so that nothing is compiled in flight."""
    numbers, flags = np.zeros(1), np.ones(1, np.bool_)
    codes, vectors = np.zeros(1, np.uint8), np.zeros((1, 3))
    head = BatchHead(1, 0, 1, 0, ShowPhase.IDLE, True, 1.0, 0.0, ())
    sent = StateBatch(
        head,
        position_m=vectors,
        velocity_m_s=vectors,
        unfiltered_m_s=vectors,
        desired_m_s=vectors,
        setpoint_m_s=vectors,
        uncertainty_m=numbers,
        age_s=numbers,
        phases=codes,
        modes=codes,
        airborne=flags,
        formed=flags,
        slot_stays=flags,
        armed=flags,
        ready=flags,
        owned=flags,
        epochs=codes,
        yaw_rad=numbers,
        numbers=[numbers] * len(SENT),
    )
    reported = ReportedVehicles.unknown(1)
    take(reported, np.zeros(1, np.intp), decode_batch(sent.encode())[1], 0, 0.0)
    at_time(reported, ~flags, np.zeros(2, np.bool_), np.zeros(2, np.bool_), 0.0, 1.0)
    SlotsMessage.decode(SlotsMessage(1, 1, 0, vectors).encode())
