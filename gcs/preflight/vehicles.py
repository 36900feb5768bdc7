"""Checks of single vehicles. Pure."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import hypot, inf, isfinite, isinf, isnan

import numpy as np

from gcs.config.sections import PreflightSettings
from gcs.estimation.fleet_state import FAR_M
from gcs.estimation.height_bias import HeightBias
from gcs.estimation.pad_places import SETTLES_S, Moved
from gcs.estimation.positioning import Positioning
from gcs.links.link import Absent
from gcs.model.frames import ShowFrame
from gcs.model.preflight_report import Check, State
from gcs.model.state import Array, FleetState, Mask, Telemetry, VehicleId
from gcs.safety.fenced_areas import beyond_m
from gcs.safety.floor import Floor
from gcs.safety.walls import Fence


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """Where k further vehicles are, which are not checked themselves."""

    names: tuple[str, ...]  # as problems show them
    place_m: Array  # (k, 2), show frame; NaN: not known
    uncertainty_m: Array  # (k,)


@dataclass(frozen=True, slots=True, eq=False)
class PreflightInputs:
    """Inputs for the whole fleet. Rows as in FleetState."""

    fleet: FleetState
    rows: Mapping[VehicleId, int]  # of FleetState
    telemetry: Telemetry
    conflicts: Mapping[VehicleId, str]  # system ids received from two addresses
    uncertainty_m: Array  # (n,) standard deviation of each position, sideways
    age_max_s: float  # of a position
    floor: Floor  # pads closer than minimum separation and margin would violate it on the way up
    fence: Fence  # pads beyond its distance are not at the show's site
    positioning: Positioning  # limits of reported accuracy
    settings: PreflightSettings
    passed: frozenset[tuple[VehicleId, str]] = frozenset()  # vehicles, and checks that they passed before
    pads_within_m: float = np.inf  # of the origin; the autopilots' own fences are wide enough for no others
    battery_need: float | None = 0.0  # of a selected show, share of a full battery; None: not known
    speed_need_m_s: float = 0.0  # of a selected show, sideways
    speed_max_m_s: Array | None = None  # (n,) that a vehicle is configured for
    others: Placed | None = None  # of other stations
    ahead_s: float = 0.0  # our Unix time minus the loop's clock
    heights: HeightBias | None = None  # rows as in FleetState
    moved: Moved | None = None  # the same
    foreign: Mapping[VehicleId, str] = field(default_factory=dict)  # another autopilot than configured
    without_autopilot: Mapping[VehicleId, Absent] = field(default_factory=dict)  # other components only
    frame: ShowFrame | None = None  # of the show
    complaints: Mapping[VehicleId, Sequence[str]] = field(default_factory=dict)  # why it would not arm

    def is_placed(self, row: int) -> bool:
        """Whether its position is fresh, so that it can be checked."""
        return bool(self.fleet.age_s[row] <= self.age_max_s)


PAD_HEIGHT_MAX_M = 3.0
"""A pad may be this much above or below the show's origin, from which obstacles, heights and landing sites
count. More is a wrong origin, or an altitude of another datum (ellipsoid instead of AMSL: tens of metres).
"""

NEAR_DEG = 0.1
"""So near to the show's origin, if latitude and longitude of that are exchanged, they seem to be."""

FIX_3D = 3
FIXES = {0: "no receiver", 1: "none", 2: "2D", 3: "3D", 4: "DGPS", 5: "RTK float", 6: "RTK fixed"}

SENSOR_NAMES = {
    0x1: "gyroscope",
    0x2: "accelerometer",
    0x4: "magnetometer",
    0x8: "barometer",
    0x20: "GPS",
    0x100000: "its own fence",
    0x200000: "position and attitude estimate",
}
"""Of MAV_SYS_STATUS_SENSOR, those that it flies by."""

BY_RECEIVER = 0x20 | 0x100000 | 0x200000
"""Of these, those that a bad receiver alone makes unhealthy."""

OF_RECEIVER = re.compile(r"gps|gnss|position|ekf|navigation", re.IGNORECASE)
"""What an autopilot says of a bad receiver."""

SAYS_MAX, SAYS_LENGTH = 4, 60
"""So many of its texts are quoted, and so much of each."""

RECEIVED_BY = ("fix", "accuracy sideways", "accuracy up", "position")
POSITIONED_BY = (*RECEIVED_BY, "jump")
"""Checks from which a wrong place follows."""


def fix_words(inputs: PreflightInputs, row: int) -> str:
    """The kind of its receiver's fix, and the accuracy that decides its margin, as reported."""
    received = inputs.telemetry
    kind, level_m = float(received.fix_type[row]), float(received.horizontal_accuracy_m[row])
    named = FIXES.get(int(kind)) if isfinite(kind) else None
    reported_m = np.fmax(level_m, received.vertical_accuracy_m[row] / inputs.floor.vertical_uncertainty)
    fix = "an unknown fix" if named is None else f"{'an' if named.startswith('R') else 'a'} {named} fix"
    return f"{fix} of {reported_m:.2g} m" if isfinite(reported_m) else fix


def judged(
    name: str,
    value: float,
    unit: str,
    limit: str,
    problem: str,
    to_do: str,
    *,
    good: bool,
    depends_on: tuple[str, ...] = (),
) -> Check:
    """Return the check of a number; NaN is unknown and does not pass."""
    if good and not isnan(value):
        return Check(name, State.PASS, finite(value), unit, limit)
    state = State.UNKNOWN if isnan(value) else State.FAIL
    return Check(name, state, finite(value), unit, limit, problem, to_do, depends_on)


def finite(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def own_checks(inputs: PreflightInputs, vehicle_id: VehicleId) -> list[Check]:
    """Return all checks of one vehicle except its parameters and its position relative to others."""
    row = inputs.rows[vehicle_id]
    return [
        _address(inputs, vehicle_id),
        _position(inputs, row),
        *_receiver(inputs, row),
        _estimator(inputs, vehicle_id),
        _battery(inputs, row),
        *_jump(inputs, row),
        *_origin(inputs, row),
        *_speed(inputs, row),
        *_drift(inputs, row),
        *_clock(inputs, row),
    ]


def _address(inputs: PreflightInputs, vehicle_id: VehicleId) -> Check:
    conflict, limit = inputs.conflicts.get(vehicle_id), "one address for each system id"
    if conflict is None:
        return Check("address", State.PASS, limit=limit)
    return Check("address", State.FAIL, None, "", limit, conflict, "give each vehicle a system id of its own")


def _position(inputs: PreflightInputs, row: int) -> Check:
    """Check that the position is fresh: received, recently, and plausible (`gcs.estimation.fleet_state`)."""
    age_s, limit = float(inputs.fleet.age_s[row]), f"at most {inputs.age_max_s:g} s old"
    if inputs.is_placed(row):
        return Check("position", State.PASS, age_s, "s", limit)
    if isfinite(age_s):
        problem, to_do = f"no position for {age_s:.1f} s", "wait, or look after its link"
    elif inputs.fleet.time_s - inputs.telemetry.position_time_s[row] <= inputs.age_max_s:
        problem, to_do = _not_believed(inputs, row)
    else:
        problem, to_do = "no position yet", "wait for its fix, or look after its link"
    value_s = age_s if isfinite(age_s) else np.nan
    return judged("position", value_s, "s", limit, problem, to_do, good=False, depends_on=("fix",))


def _not_believed(inputs: PreflightInputs, row: int) -> tuple[str, str]:
    """Why a position that is received is not believed, in words, and what to do."""
    frame, to_do = inputs.frame, "check its GPS and show_frame"
    at_deg = inputs.telemetry.latitude_deg[row : row + 1], inputs.telemetry.longitude_deg[row : row + 1]
    (latitude_deg,), (longitude_deg,) = at_deg
    if frame is not None and latitude_deg and longitude_deg:
        away_m = float(np.linalg.norm(frame.position_m(*at_deg, np.array([frame.altitude_amsl_m]))))
        if away_m > FAR_M:
            place = f"{latitude_deg:.4f}, {longitude_deg:.4f}"
            if hypot(latitude_deg - frame.longitude_deg, longitude_deg - frame.latitude_deg) < NEAR_DEG:
                to_do = "exchange latitude and longitude in show_frame: it is where they would be then"
            far = f"it is at {place} (latitude, longitude), {away_m / 1e3:.0f} km from the show's origin"
            return f"no position to believe: {far}", to_do
    return "no position to believe: it jumped, or is kilometres away", to_do


def _receiver(inputs: PreflightInputs, row: int) -> Iterator[Check]:
    """Check fix and accuracy: beyond the cap the margin is smaller than the accuracy requires."""
    if not inputs.settings.require_fix:
        return
    received, positioning = inputs.telemetry, inputs.positioning
    kind = float(received.fix_type[row])
    named = "not reported yet" if isnan(kind) else FIXES.get(int(kind), f"of type {kind:g}")
    problem, limit = f"its receiver's fix is {named}, 3D is needed", f"GPS_FIX_TYPE at least {FIX_3D}"
    yield judged("fix", kind, "", limit, problem, "wait, under an open sky", good=kind >= FIX_3D)
    level_m, up_m = float(received.horizontal_accuracy_m[row]), float(received.vertical_accuracy_m[row])
    problem = "its receiver does not tell its accuracy"
    if isfinite(level_m) and isfinite(up_m):
        of = f"its receiver reports an accuracy of {level_m:.1f} m sideways and {up_m:.1f} m up"
        problem = f"{of}: too little for any margin"
    widest_m = positioning.accepted_m(received.fix_type)
    for value_m, name, most_m in (
        (level_m, "accuracy sideways", widest_m),
        (up_m, "accuracy up", inputs.floor.vertical_uncertainty * widest_m),
    ):
        limit = f"below {most_m:.1f} m (1 sigma)"
        good, after = value_m < most_m, ("fix", "accuracy sideways")[: 2 if name == "accuracy up" else 1]
        yield judged(name, value_m, "m", limit, problem, "wait for a better fix", good=good, depends_on=after)


def _estimator(inputs: PreflightInputs, vehicle_id: VehicleId) -> Check:
    """Check what the autopilot is, and what it reports of its sensors, estimator, and arming checks."""
    row, foreign = inputs.rows[vehicle_id], inputs.foreign.get(vehicle_id)
    absent = inputs.without_autopilot.get(vehicle_id)
    if absent is not None:
        return Check("autopilot", State.FAIL, None, "", "received, component 1", *absent)
    if foreign is not None:
        to_do = "correct autopilot in the configuration, of the vehicle or its link"
        return Check("autopilot", State.FAIL, None, "", "as configured", foreign, to_do)
    unhealthy, ready = int(inputs.telemetry.unhealthy_sensors[row]), inputs.telemetry.ready[row]
    limit = "its own checks before arming pass"
    if unhealthy < 0:
        problem = "its autopilot has not reported its health yet"
        return Check("autopilot", State.UNKNOWN, None, "", limit, problem, "wait")
    if ready and not unhealthy:
        return Check("autopilot", State.PASS, limit=limit)
    names = ", ".join(name for bit, name in SENSOR_NAMES.items() if unhealthy & bit)
    problem = "its autopilot does not yet pass its own arming checks"
    if ready:
        problem = "its autopilot calls unhealthy what it flies by"
    if names:
        problem += f": {names}"
    says = [] if ready else inputs.complaints.get(vehicle_id, ())
    to_do = "wait, and read what it says"
    if says:
        more = f" and {len(says) - SAYS_MAX} more" if len(says) > SAYS_MAX else ""
        quoted = ", ".join(f'"{text[:SAYS_LENGTH]}"' for text in says[:SAYS_MAX])
        problem, to_do = f"{problem}; it says {quoted}{more}", "mend what it says"
    by_receiver = not unhealthy & ~BY_RECEIVER and all(map(OF_RECEIVER.search, says))
    by_place = RECEIVED_BY if by_receiver else ()
    return Check("autopilot", State.FAIL, None, "", limit, problem, to_do, by_place)


def _battery(inputs: PreflightInputs, row: int) -> Check:
    left, need = float(inputs.telemetry.battery_remaining[row]), inputs.battery_need
    flat = inputs.settings.battery_min
    if need is None:
        problem = "what the selected show needs of a battery is not known"
        to_do = "check and select it again"
        return Check("battery", State.UNKNOWN, finite(left), "of 1", "the show's need", problem, to_do)
    least = max(need, flat)
    level = "unknown" if isnan(left) else f"at {left:.0%}"
    show_note = " for this show" if need > flat else ""
    limit, problem = f"at least {least:.0%}{show_note}", f"battery {level}, at least {least:.0%} is needed"
    to_do = "charge it, or put in a full one" if least <= 1.0 else "choose a shorter show"
    return judged("battery", left, "of 1", limit, f"{problem}{show_note}", to_do, good=left >= least)


def _of_one_or_all(inputs: PreflightInputs, row: int, right: Mask, to_do: str) -> str:
    """What mends a position that is wrong: where most of the others are `right` (n,), it is not the frame."""
    others: Mask = np.isfinite(inputs.fleet.position_m).all(axis=1) & (np.arange(len(right)) != row)
    if others.any() and right[others].mean() > 0.5:
        return f"reboot it where it stands: most of the others are right; if it does stand there, {to_do}"
    return to_do


def _origin(inputs: PreflightInputs, row: int) -> Iterator[Check]:
    """Check that its pad is where pads are expected around the show's origin."""
    if not inputs.is_placed(row):
        return  # reported by the position check
    place_m, fence = inputs.fleet.position_m[row], inputs.fence
    height_m, distance_m = -float(place_m[2]), float(np.hypot(place_m[0], place_m[1]))
    beside = f"{abs(height_m):.1f} m {'above' if height_m > 0.0 else 'below'} the show's origin"
    limit = f"from -{PAD_HEIGHT_MAX_M:g} to {PAD_HEIGHT_MAX_M:g} m"
    problem = f"stands {beside}, at most {PAD_HEIGHT_MAX_M:g} m is possible"
    good = abs(height_m) <= PAD_HEIGHT_MAX_M
    heights_m, distances_m = -inputs.fleet.position_m[:, 2], np.hypot(*inputs.fleet.position_m[:, :2].T)
    to_do = _of_one_or_all(
        inputs, row, np.abs(heights_m) <= PAD_HEIGHT_MAX_M, "check show_frame.altitude_amsl_m"
    )
    yield judged(
        "height of the origin", height_m, "m", limit, problem, to_do, good=good, depends_on=POSITIONED_BY
    )
    least_m = min(fence.distance_max_m, inputs.pads_within_m)
    away = f"stands {distance_m:.0f} m from the show's origin"
    if distance_m > fence.distance_max_m:
        problem = f"{away}, beyond the fence at {fence.distance_max_m:g} m"
        to_do = "check show_frame"
    else:
        problem = f"{away}, its autopilot's fence allows for {inputs.pads_within_m:g} m"
        to_do = "check show_frame, or raise operation.pads_within_m and apply the parameters again"
    to_do = _of_one_or_all(inputs, row, distances_m <= least_m, to_do)
    limit, good = f"at most {least_m:g} m" if least_m < inf else "none", distance_m <= least_m
    yield judged(
        "distance of the origin", distance_m, "m", limit, problem, to_do, good=good, depends_on=POSITIONED_BY
    )
    if fence.areas:
        over_m = float(beyond_m(fence.areas, place_m[None, :2])[0])
        problem = f"stands {over_m:.1f} m beyond the fence of the show's drawing"
        to_do = "move it inside, or place the show anew"
        yield judged(
            "area of the fence",
            over_m,
            "m",
            "inside",
            problem,
            to_do,
            good=over_m <= 0.0,
            depends_on=POSITIONED_BY,
        )


def _jump(inputs: PreflightInputs, row: int) -> Iterator[Check]:
    """Check that it is reported where it has stood since it was ready, as far as that is known."""
    moved = inputs.moved
    if moved is None or isnan(moved.way_m[row, 0]):
        return
    limit_m, good = moved.limit_m[row], isinf(moved.since_s[row])
    limit = f"at most {limit_m[0]:.1f} m sideways and {limit_m[1]:.1f} m up or down"
    by, ago = moved.in_words(row, inputs.fleet.time_s)
    problem = f"its position moved by {by} while it stood, {ago}"
    to_do = "reboot it where it stands; or confirm its place: leave it out, and include it again"
    if not good and not moved.away[row]:
        problem = f"its position moved away while it stood, {ago}, and is back for less than {SETTLES_S:g} s"
        to_do = "wait"
    far_m = float(moved.by_m[row].max())
    yield judged("jump", far_m, "m", limit, problem, to_do, good=good, depends_on=RECEIVED_BY)


def _speed(inputs: PreflightInputs, row: int) -> Iterator[Check]:
    """Check that it may fly as fast as the show needs, if it has a limit of its own."""
    if inputs.speed_max_m_s is None or not inputs.speed_need_m_s or not isfinite(inputs.speed_max_m_s[row]):
        return
    able_m_s, need_m_s = float(inputs.speed_max_m_s[row]), inputs.speed_need_m_s
    limit = f"at least {need_m_s:g} m/s for this show"
    problem = f"flies at most {able_m_s:g} m/s, this show needs {need_m_s:g} m/s"
    to_do = "raise its speed_max_m_s if it can fly so fast, take it out of the show, or write a slower one"
    yield judged("speed", able_m_s, "m/s", limit, problem, to_do, good=able_m_s >= need_m_s)


def _drift(inputs: PreflightInputs, row: int) -> Iterator[Check]:
    """Check that its height has stayed with its receiver's while it stood, as far as that is known."""
    found = inputs.heights
    if found is None or not isfinite(found.bias_m[row]):
        return
    limit = "as its receiver's, compared with the others (heights.bias_max_m)"
    problem = f"its height has drifted: it stands {found.in_words(row)}"
    to_do, good = "reboot it where it stands, and look after its barometer", not found.named[row]
    yield judged("drift of the height", float(found.bias_m[row]), "m", limit, problem, to_do, good=good)


def _clock(inputs: PreflightInputs, row: int) -> Iterator[Check]:
    """Compare clocks: vehicles have satellite time, so a difference shows that one clock is wrong."""
    most_s = inputs.settings.clock_max_s
    if most_s is None:
        return
    ahead_s = float(inputs.telemetry.clock_base_s[row]) - inputs.ahead_s
    if isnan(ahead_s):
        problem, to_do = "its clock has not reported the time yet", "wait for its fix"
    else:
        beside = f"{abs(ahead_s):.1f} s {'ahead of' if ahead_s > 0.0 else 'behind'} this machine's"
        problem = f"its clock is {beside}, at most {most_s:g} s"
        to_do = "set this machine's clock (NTP) if all differ alike, else look after the vehicle's receiver"
    limit = f"at most {most_s:g} s from ours"
    good = abs(ahead_s) <= most_s
    yield judged("clock", ahead_s, "s", limit, problem, to_do, good=good, depends_on=("fix",))
