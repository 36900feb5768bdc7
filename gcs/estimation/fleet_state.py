"""The fleet's state from the telemetry of all links: which positions are accepted, and brought forward."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from math import isfinite
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.estimation.contradictions import Contradictions, Doubt, Doubts, explaining_s
from gcs.model.frames import ShowFrame
from gcs.model.jit import kernel
from gcs.model.state import (
    FIX_3D,
    Array,
    Bits,
    FleetState,
    Landed,
    Mask,
    Mode,
    Telemetry,
    VehicleId,
)

FORWARD_MAX_S: Final = 0.5
"""Longest time by which positions are brought forward; older ones are refused by their age anyway."""

SPEED_PLAUSIBLE_M_S, JUMP_PLAUSIBLE_M = 25.0, 10.0
"""A position is not accepted if it is farther from the last accepted one than this speed and jump explain."""

UNEXPLAINED_M, UNEXPLAINED_M_S = 1.5, 2.0
"""An accepted position that is off by more than this and this speed from where the velocity led is a reset of
the estimator or of its receiver. Noise comes in centimetres a step.
"""

ANNOUNCED_M, ANNOUNCED_S = 0.3, 1.0
"""Off by this is a reset as well, if the estimator counts one within this time, before or after: the counter
comes in another message. It counts resets of the heading also, as after every take-off, which move nothing.
"""

FAR_M: Final = 10_000.0
"""A position is not accepted farther than this from the show's origin, or at latitude and longitude 0."""

JUMPS_COUNT_S: Final = 30.0
"""Jumps that follow each other within this time add up."""

CONSISTENT_S: Final = 2.0
"""How long a vehicle must be reported at a new place, without a jump, before that is accepted."""

_SEMIMAJOR_M: Final = 6378137.0
_FLATTENING: Final = 1.0 / 298.257223563
_POLAR_SHARE: Final = (1.0 - _FLATTENING) ** 2
"""WGS84, as pymap3d has it."""


@kernel
def _geocentric_m(latitude: float, longitude: float, altitude_m: float) -> tuple[float, float, float]:
    """From the centre of the earth, angles in radians: towards 0 E, towards 90 E, north."""
    sine, cosine = np.sin(latitude), np.cos(latitude)
    normal_m = _SEMIMAJOR_M / np.sqrt(cosine * cosine + _POLAR_SHARE * sine * sine)
    ring_m = (normal_m + altitude_m) * cosine
    return (
        ring_m * np.cos(longitude),
        ring_m * np.sin(longitude),
        (_POLAR_SHARE * normal_m + altitude_m) * sine,
    )


@kernel
def into_frame(
    rows: NDArray[np.intp],
    place: tuple[Array, Array, Array, Array],
    velocity_ned_m_s: Array,
    arrived_s: Array,
    reported: tuple[Mask, Bits],
    origin: tuple[float, float, float, float],
    into: tuple[Array, Array, Array, Array, Mask, Mask, Bits],
) -> None:
    """Telemetry of one link's vehicles in the show frame. `ShowFrame.position_m` is the same by pymap3d.

    Args:
        rows: (k,) row of each in the fleet.
        place: latitude and longitude in degrees, altitude AMSL, and yaw in degrees clockwise from north, (k,)
            each.
        velocity_ned_m_s: (k, 3).
        arrived_s: (k,) of the position.
        reported: (k,) armed, and the reset counter.
        origin: latitude, longitude, altitude AMSL and heading of the show frame.
        into: position and velocity (n, 3), yaw (n,) from the show's x axis within [-pi, pi), time of arrival,
            whether the position is possible at all, armed, and reset counter; these rows are written.
    """
    (latitude_deg, longitude_deg, altitude_m, yaw_deg), (is_armed, reset_count) = place, reported
    position_m, velocity_m_s, yaw_rad, time_s, exists, armed, resets = into
    latitude, longitude = np.radians(origin[0]), np.radians(origin[1])
    sine, cosine = np.sin(latitude), np.cos(latitude)
    sine_east, cosine_east = np.sin(longitude), np.cos(longitude)
    sine_turned, cosine_turned = np.sin(np.radians(origin[3])), np.cos(np.radians(origin[3]))
    x0_m, y0_m, z0_m = _geocentric_m(latitude, longitude, origin[2])
    for k in range(len(rows)):
        i = rows[k]
        x_m, y_m, z_m = _geocentric_m(
            np.radians(latitude_deg[k]), np.radians(longitude_deg[k]), altitude_m[k]
        )
        x_m, y_m, z_m = x_m - x0_m, y_m - y0_m, z_m - z0_m
        out_m, east_m = cosine_east * x_m + sine_east * y_m, cosine_east * y_m - sine_east * x_m
        north_m, down_m = cosine * z_m - sine * out_m, -(cosine * out_m + sine * z_m)
        position_m[i, 0] = cosine_turned * north_m + sine_turned * east_m
        position_m[i, 1] = cosine_turned * east_m - sine_turned * north_m
        position_m[i, 2] = down_m
        north_m_s, east_m_s = velocity_ned_m_s[k, 0], velocity_ned_m_s[k, 1]
        velocity_m_s[i, 0] = cosine_turned * north_m_s + sine_turned * east_m_s
        velocity_m_s[i, 1] = cosine_turned * east_m_s - sine_turned * north_m_s
        velocity_m_s[i, 2] = velocity_ned_m_s[k, 2]
        yaw_rad[i] = (np.radians(yaw_deg[k] - origin[3]) + np.pi) % (2.0 * np.pi) - np.pi
        time_s[i], armed[i], resets[i] = arrived_s[k], is_armed[k], reset_count[k]
        square = north_m * north_m + east_m * east_m + down_m * down_m
        exists[i] = square <= FAR_M * FAR_M and (latitude_deg[k] != 0.0 or longitude_deg[k] != 0.0)


@kernel
def _apart_m(one_m: Array, other_m: Array) -> float:
    """Distance between two (3,); inf where either is unknown."""
    apart_m = np.sqrt(
        (one_m[0] - other_m[0]) ** 2 + (one_m[1] - other_m[1]) ** 2 + (one_m[2] - other_m[2]) ** 2
    )
    return apart_m if np.isfinite(apart_m) else np.inf


@kernel
def _plausible_m(since_s: float, time_s: float) -> float:
    """Plausible distance of a position at `time_s`; only the jump where none was known before."""
    elapsed_s = time_s - since_s if np.isfinite(since_s) and time_s > since_s else 0.0
    return JUMP_PLAUSIBLE_M + SPEED_PLAUSIBLE_M_S * elapsed_s


@kernel
def _is_reset(now_s: float, jumped: bool, stepped_s: float, counted_s: float, reset_time_s: float) -> bool:
    """Whether a position was reset now; arguments as of `judge`.

    A jump and the counter beside it are one reset, whichever comes first.
    """
    announced = now_s in (stepped_s, counted_s) and abs(stepped_s - counted_s) <= ANNOUNCED_S
    return jumped or (announced and not now_s - reset_time_s <= ANNOUNCED_S)


@kernel
def _new_s(doubt: int, believed_s: float, held_s: float) -> float:
    """When a position that is the same since `held_s` was new: a repeated one ages from then on."""
    repeated = doubt in (Doubt.STANDS, Doubt.STANDS_COMMANDED)
    return min(believed_s, held_s) if repeated else believed_s


@kernel
def judge(
    now_s: float,
    position_m: Array,
    time_s: Array,
    velocity_m_s: Array,
    exists: Mask,
    armed: Mask,
    resets: Bits,
    clock_s: Array,
    reported_m: Array,
    reported_s: Array,
    reported_since_s: Array,
    believed_m: Array,
    believed_s: Array,
    believed_m_s: Array,
    trusted: Mask,
    believed_clock_s: Array,
    known_resets: Bits,
    counted_s: Array,
    stepped_s: Array,
    stepped_m: Array,
    reset_time_s: Array,
    jumped_m: Array,
    doubts: Doubts,
    held_s: Array,
) -> None:
    """Accept new positions, or do not: see `gcs.estimation.fleet_state.Table`.

    Args:
        now_s: of this tick.
        position_m: (n, 3) as reported now, NaN where unknown, and so are the next five.
        time_s: (n,) of arrival, -inf before the first.
        velocity_m_s: (n, 3).
        exists: (n,) whether the position is possible at all.
        armed: (n,).
        resets: (n,) reset counters of the estimators.
        clock_s: (n,) the vehicle's clock in it, NaN unknown.
        reported_m: (n, 3) the newest reported, accepted or not; written, as all that follow.
        reported_s: (n,) of its arrival.
        reported_since_s: (n,) since when it was reported without a jump, of vehicles not trusted.
        believed_m: (n, 3) the newest accepted.
        believed_s: (n,) of its arrival.
        believed_m_s: (n, 3) the velocity with it.
        trusted: (n,) whether the newest was accepted.
        believed_clock_s: (n,) the clock in it.
        known_resets: (n,).
        counted_s: (n,) when the estimator last counted a reset.
        stepped_s: (n,) when the position was last off by so much as counts beside a counted reset.
        stepped_m: (n,) by how much.
        reset_time_s: (n,) when the position last jumped.
        jumped_m: (n,) how far, with the jumps less than JUMPS_COUNT_S before.
        doubts: (n,) `Doubt` of each, not written, as the next.
        held_s: (n,) since when each position is the same.
    """
    for i in range(len(time_s)):
        jumped = False
        counted = resets[i] != known_resets[i] and known_resets[i] >= 0
        counted_s[i] = now_s if counted else counted_s[i]
        known_resets[i] = resets[i]
        if time_s[i] > reported_s[i]:
            off_m, before_m = _apart_m(position_m[i], believed_m[i]), _apart_m(position_m[i], reported_m[i])
            first = not np.isfinite(believed_s[i])
            can_be = first or off_m <= _plausible_m(believed_s[i], time_s[i])
            went_on = before_m <= _plausible_m(reported_s[i], time_s[i])
            since_s = reported_since_s[i] if went_on and not trusted[i] else time_s[i]
            settled = went_on and time_s[i] - since_s >= CONSISTENT_S
            if trusted[i] or first:
                believe = can_be
            else:
                believe = (can_be and off_m <= before_m) or (settled and (can_be or not armed[i]))
            believe = believe and exists[i] and doubts[i] == 0
            reported_m[i] = position_m[i] if exists[i] else np.full(3, np.nan)
            reported_s[i], reported_since_s[i], trusted[i] = time_s[i], since_s, believe
            if believe:
                if not first:
                    elapsed_s, mean_m_s = time_s[i] - believed_s[i], (believed_m_s[i] + velocity_m_s[i]) / 2.0
                    step_m, by_clock_s = position_m[i] - believed_m[i], clock_s[i] - believed_clock_s[i]
                    moved_m = mean_m_s * explaining_s(step_m, mean_m_s, elapsed_s, by_clock_s)
                    off_m = _apart_m(position_m[i], believed_m[i] + moved_m)
                    jumped = off_m > UNEXPLAINED_M + UNEXPLAINED_M_S * elapsed_s
                    if off_m > ANNOUNCED_M:
                        stepped_s[i], stepped_m[i] = now_s, off_m
                believed_m[i], believed_s[i], believed_clock_s[i] = position_m[i], time_s[i], clock_s[i]
            elif doubts[i] == Doubt.LATE and can_be and exists[i]:  # where it was, though not where it is
                believed_m[i], believed_s[i], believed_m_s[i] = position_m[i], held_s[i], velocity_m_s[i]
                believed_clock_s[i] = np.nan
        if believed_s[i] == time_s[i]:
            believed_m_s[i] = velocity_m_s[i]
        believed_s[i] = _new_s(doubts[i], believed_s[i], held_s[i])
        if armed[i] and _is_reset(now_s, jumped, stepped_s[i], counted_s[i], reset_time_s[i]):
            goes_on = now_s - reset_time_s[i] <= JUMPS_COUNT_S
            jumped_m[i] = stepped_m[i] + (jumped_m[i] if goes_on else 0.0)
            reset_time_s[i] = now_s


@kernel
def brought_forward(
    now_s: float,
    believed_m: Array,
    believed_s: Array,
    believed_m_s: Array,
    trusted: Mask,
    flies_on_s: float,
    brakes_s: float,
) -> tuple[Array, Array, Array]:
    """Estimate the fleet's motion at `now_s`; see `gcs.estimation.fleet_state.Table`.

    Returns: (n, 3) positions, (n, 3) velocities, and the (n,) age of the positions, inf where the newest is
        not accepted.
    """
    position_m, velocity_m_s = np.empty_like(believed_m), np.empty_like(believed_m_s)
    age_s = np.empty(len(believed_s))
    for i in range(len(believed_s)):
        old_s = max(now_s - believed_s[i], 0.0)
        share = min(max(1.0 - (old_s - flies_on_s) / brakes_s, 0.0), 1.0)
        for axis in range(3):
            position_m[i, axis] = believed_m[i, axis] + believed_m_s[i, axis] * min(old_s, FORWARD_MAX_S)
            velocity_m_s[i, axis] = believed_m_s[i, axis] * share
        age_s[i] = old_s if trusted[i] else np.inf
    return position_m, velocity_m_s, age_s


FLIES_ON_S: Final = 2.0
"""Age of telemetry up to which a vehicle may fly on unchanged, with PX4's and the service's defaults: 0.5 s
for which positions are brought forward, the watchdog's 0.2 s and COM_OF_LOSS_T of 1 s; or the 2 s after which
it counts as lost, whichever is longer.
"""

BRAKES_S: Final = 2.0
"""Even braking over this time covers the distance of 1 s of unchanged flight (`STOP_S`)."""


@dataclass(frozen=True, slots=True, eq=False)
class _LinkColumns:
    """Columns of Python values of one link's telemetry, as arrays."""

    ids: tuple[VehicleId, ...]
    armed: tuple[bool, ...]
    resets: tuple[int, ...]
    rows: NDArray[np.intp]  # (k,) of its vehicles in the fleet
    is_armed: Mask  # (k,)
    reset_count: Bits  # (k,)

    def describes(self, part: Telemetry) -> bool:
        """Whether they are of this telemetry; unchanged columns are the same objects."""
        same = part.armed is self.armed and part.position_resets is self.resets
        return same and part.ids is self.ids


class Table:
    """Joins the telemetry of all links into one state, rows in the fleet's own order.

    It keeps the last accepted position of each vehicle, since a reported position may be wrong (a receiver
    that glitches, an estimator that resets, another vehicle's messages). While a vehicle reports implausible
    positions, its row keeps the last accepted one, and the age inf: it is not commanded. Its positions are
    accepted again at once where they return to a reachable place, and otherwise after CONSISTENT_S at the new
    place: in the air only if it can have flown there, on the ground (not armed) anywhere.

    The velocity of a vehicle without new telemetry ends. For `flies_on_s` it is the last reported one: the
    vehicle may fly on until its autopilot notices the loss, and other vehicles must keep clear of it by
    this estimate alone until it counts as lost. Within `brakes_s` it then fades to rest, as of a vehicle
    that brakes; a falling vehicle does not move sideways for long either. The growing uncertainty is not in
    the velocity: from the loss on, the swept space (`gcs.planning.lost_space.swept_segments_m`) covers
    every place that the vehicle can have reached with the whole of `last_velocity_m_s`, however long ago that
    was.

    Attributes:
        reset_time_s: (n,) when the position last jumped beyond what the velocity explains; beside a reset
            that the estimator counts, a smaller jump counts as well; -inf where it never did. Only of armed
            vehicles: an estimator that starts up also jumps.
        jumped_m: (n,) how far it jumped then, and before, less than JUMPS_COUNT_S apart: it may be wherever
            it was reported.
    """

    def __init__(
        self,
        ids: Sequence[VehicleId],
        frame: ShowFrame,
        *,
        flies_on_s: float = FLIES_ON_S,
        brakes_s: float = BRAKES_S,
    ) -> None:
        self._flies_on_s, self._brakes_s = flies_on_s, brakes_s
        self.ids = tuple(ids)
        self._row = {vehicle_id: row for row, vehicle_id in enumerate(self.ids)}
        self._links: list[_LinkColumns] = []  # as of the last call of `state`
        self._origin = (frame.latitude_deg, frame.longitude_deg, frame.altitude_amsl_m, frame.heading_deg)
        n = len(self.ids)
        # accepted: position, its time, the velocity that came with it, and whether the newest was accepted
        self._believed: tuple[Array, Array, Array, Mask]
        self._believed = _unknown(n), np.full(n, -np.inf), _unknown(n), np.ones(n, np.bool_)
        # accepted or not: position, its time, and since when without a jump, of vehicles not trusted
        self._reported: tuple[Array, Array, Array] = _unknown(n), np.full(n, -np.inf), np.full(n, np.inf)
        self._believed_clock_s = np.full(n, np.nan)
        self._resets = np.full(n, -1)  # reset counters of the estimators
        self._counted_s, self._stepped_s = np.full(n, -np.inf), np.full(n, -np.inf)
        self._stepped_m = np.zeros(n)
        self.reset_time_s, self.jumped_m = np.full(n, -np.inf), np.zeros(n)
        self._contradictions = Contradictions(n)
        self._not_known, self._never_s = _unknown(n), np.full(n, -np.inf)

    @property
    def doubts(self) -> Doubts:
        """(n,) `Doubt` of each vehicle's newest position."""
        return self._contradictions.doubts

    def state(
        self, telemetry: Sequence[Telemetry], now_s: float, asked_m_s: Array | None = None
    ) -> FleetState:
        """The fleet at `now_s`: newest accepted positions, brought forward with their velocities.

        Called once a tick; a second call with the same telemetry has the same result.

        Args:
            telemetry: of all links.
            now_s: of this tick.
            asked_m_s: (n, 3) setpoints of the last tick, NaN: not commanded; None: no vehicle was.
        """
        n = len(self.ids)
        position_m, velocity_m_s = self._not_known.copy(), self._not_known.copy()
        yaw_rad, time_s = self._not_known[:, 0].copy(), self._never_s.copy()
        exists, armed = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
        resets = self._resets.copy()
        self._links = [
            self._columns(part, before)
            for part, before in zip_longest(telemetry, self._links[: len(telemetry)])
        ]
        doubtful, late_s = np.zeros(n, np.bool_), np.zeros(n)
        clock_s, accuracy_m = np.full(n, np.nan), np.full(n, np.nan)
        for part, link in zip(telemetry, self._links, strict=True):
            doubtful[link.rows] = part.fix_type < FIX_3D  # False for NaN
            late_s[link.rows] = part.position_late_s
            clock_s[link.rows], accuracy_m[link.rows] = part.position_clock_s, part.horizontal_accuracy_m
            into_frame(
                link.rows,
                (part.latitude_deg, part.longitude_deg, part.altitude_amsl_m, part.yaw_deg),
                part.velocity_ned_m_s,
                part.position_time_s,
                (link.is_armed, link.reset_count),
                self._origin,
                (position_m, velocity_m_s, yaw_rad, time_s, exists, armed, resets),
            )
        contradictions = self._contradictions
        asked_m_s = self._not_known if asked_m_s is None else asked_m_s
        dated = armed, late_s, clock_s, accuracy_m
        contradictions.look(now_s, (position_m, velocity_m_s, time_s, *dated), asked_m_s)
        self.reset_time_s = self.reset_time_s.copy()  # holders of the old arrays keep them unchanged
        self.jumped_m = self.jumped_m.copy()
        new = (position_m, time_s, velocity_m_s, exists, armed, resets, clock_s)
        believed = *self._believed, self._believed_clock_s
        counted = self._resets, self._counted_s, self._stepped_s, self._stepped_m
        jumps = self.reset_time_s, self.jumped_m
        doubted = contradictions.doubts, contradictions.held_s
        judge(now_s, *(*new, *self._reported, *believed, *counted, *jumps, *doubted))
        here_m, moves_m_s, age_s = brought_forward(now_s, *self._believed, self._flies_on_s, self._brakes_s)
        return FleetState(now_s, self.ids, here_m, moves_m_s, yaw_rad, age_s, doubtful)

    def _columns(self, part: Telemetry, before: "_LinkColumns | None") -> "_LinkColumns":
        """The columns of a link, which seldom change."""
        if before is not None and before.describes(part):
            return before
        rows = np.array([self._row[name] for name in part.ids], dtype=np.intp)
        columns = part.ids, part.armed, part.position_resets
        return _LinkColumns(*columns, rows, np.array(part.armed), np.array(part.position_resets, np.int64))

    def sample_age_s(self, now_s: float) -> Array:
        """(n,) since each last accepted position was measured; of late ones, which are not, the newest."""
        return np.asarray(np.maximum(now_s - self._believed[1], 0.0))

    @property
    def last_velocity_m_s(self) -> Array:
        """(n, 3) the whole velocity that came with each vehicle's last accepted position."""
        return self._believed[2].copy()


def _unknown(n: int) -> Array:
    return np.full((n, 3), np.nan)


def tuple3(row: Array) -> tuple[float, float, float] | None:
    """A finite (3,) row as floats, else None."""
    x, y, z = row.tolist()
    return (x, y, z) if isfinite(x) and isfinite(y) and isfinite(z) else None


def warm_up() -> None:
    """Compile or load the kernels, with the types that the first telemetry has."""
    never, unknown, nowhere = np.full(1, -np.inf), np.full(1, np.nan), _unknown(1)
    no, none = (False,), (0,)
    silent = Telemetry(
        ids=("",),
        position_time_s=never,
        heartbeat_time_s=never,
        life_time_s=never,
        latitude_deg=unknown,
        longitude_deg=unknown,
        altitude_amsl_m=unknown,
        velocity_ned_m_s=nowhere,
        yaw_deg=unknown,
        attitude_rad=nowhere,
        attitude_time_s=never,
        battery_remaining=unknown,
        armed=no,
        mode=(Mode.UNKNOWN,),
        in_failsafe=no,
        landed=(Landed.UNKNOWN,),
        ready=no,
        horizontal_accuracy_m=unknown,
        vertical_accuracy_m=unknown,
        gnss_altitude_amsl_m=unknown,
        reboot_count=none,
        position_resets=none,
        fix_type=unknown,
        unhealthy_sensors=np.zeros(1, np.int64),
        clock_base_s=unknown,
        round_trip_s=unknown,
        position_clock_s=unknown,
        position_late_s=np.zeros(1),
        texts=((),),
        version=none,
    )
    Table(("",), ShowFrame(0.0, 0.0, 0.0, 0.0)).state([silent], 0.0)
