"""Before take-off: who may fly, and why not. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gcs.accuracy import Positioning, excess_m
from gcs.safety.separation import Floor
from gcs.safety.walls import Fence
from gcs.state import Array, FleetState, Telemetry, VehicleId

BATTERY_MIN = 0.25

PAD_HEIGHT_MAX_M = 3.0
"""A pad may lie this much above or below the show's origin: obstacles, heights and landing places count from
there. More is a wrong origin, or an altitude of another datum (ellipsoid instead of AMSL: tens of metres).
"""


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that keeps a vehicle on the ground, and what to do about it."""

    vehicle_id: VehicleId
    problem: str


def check_fleet(
    vehicles: Sequence[VehicleId],
    fleet: FleetState,
    telemetry: Mapping[VehicleId, tuple[Telemetry, int]],
    conflicts: Mapping[VehicleId, str],
    *,
    age_max_s: float,
    floor: Floor,
    fence: Fence,
    uncertainty_m: Array,
    positioning: Positioning,
    pads_within_m: float = np.inf,
) -> list[Finding]:
    """Everything that speaks against taking off with `vehicles`.

    Args:
        vehicles: those who are to fly.
        fleet: where everybody is.
        telemetry: for each vehicle, its link's telemetry and its row there.
        conflicts: system ids heard from two addresses.
        age_max_s: of a position.
        floor: pads closer than floor and margin would break it on the way up.
        fence: pads beyond its distance are not where the show is.
        uncertainty_m: (n,) of each position, as reported.
        positioning: what receivers may report.
        pads_within_m: of the origin; the autopilots' own fences are wide enough for no others.
    """
    findings = []
    row_of = {name: row for row, name in enumerate(fleet.ids)}
    for vehicle_id in vehicles:
        row = row_of[vehicle_id]
        heard, at = telemetry[vehicle_id]
        battery = float(heard.battery_remaining[at])
        if vehicle_id in conflicts:
            findings.append(
                Finding(vehicle_id, f"{conflicts[vehicle_id]}: give each vehicle a system id of its own")
            )
        if not fleet.age_s[row] <= age_max_s:
            heard_lately = fleet.time_s - heard.position_time_s[at] <= age_max_s
            findings.append(Finding(vehicle_id, _no_position(float(fleet.age_s[row]), bool(heard_lately))))
        elif not heard.ready[at]:
            findings.append(Finding(vehicle_id, "its autopilot does not yet pass its own arming checks"))
        if not battery >= BATTERY_MIN:
            level = "unknown" if np.isnan(battery) else f"at {battery:.0%}"
            findings.append(Finding(vehicle_id, f"battery {level}, at least {BATTERY_MIN:.0%} is needed"))
        if fleet.age_s[row] <= age_max_s:
            findings += _accuracy(vehicle_id, heard, at, float(uncertainty_m[row]), positioning)
            findings += _origin(vehicle_id, fleet.position_m[row], fence, pads_within_m)
    return findings + _pads(vehicles, fleet, floor, uncertainty_m)


def _no_position(age_s: float, heard_lately: bool) -> str:
    """Why there is none: never heard, heard too long ago, or heard and not believed (`gcs.table`)."""
    if np.isinf(age_s) and heard_lately:
        return "no position to believe: it jumped, or is kilometres away; check its GPS and show_frame"
    return "no position yet" if np.isinf(age_s) else f"no position for {age_s:.1f} s"


def _accuracy(
    vehicle_id: VehicleId, heard: Telemetry, at: int, uncertainty_m: float, positioning: Positioning
) -> list[Finding]:
    """Whether its receiver is good enough: at the cap, the margin is no longer as wide as it should be."""
    if uncertainty_m < positioning.uncertainty_max_m:
        return []
    sideways_m, up_m = float(heard.horizontal_accuracy_m[at]), float(heard.vertical_accuracy_m[at])
    if not excess_m(np.array([sideways_m]), np.array([up_m]), positioning)[0] > 0.0:
        return []
    reports = f"its receiver reports an accuracy of {sideways_m:.1f} m sideways and {up_m:.1f} m up"
    return [Finding(vehicle_id, f"{reports}: too little for any margin; wait for a better fix")]


def told(findings: Sequence[Finding]) -> str:
    """All of them in words; what is true of several vehicles is said once."""
    whose: dict[str, list[VehicleId]] = {}
    for finding in findings:
        whose.setdefault(finding.problem, []).append(finding.vehicle_id)
    return "; ".join(f"{', '.join(names)}: {problem}" for problem, names in whose.items())


def _origin(vehicle_id: VehicleId, place_m: Array, fence: Fence, pads_within_m: float) -> list[Finding]:
    """Whether the pad at `place_m` (3,) lies where the show's origin says that pads are."""
    findings = []
    height_m, distance_m = -float(place_m[2]), float(np.hypot(place_m[0], place_m[1]))
    if abs(height_m) > PAD_HEIGHT_MAX_M:
        beside = f"{abs(height_m):.1f} m {'above' if height_m > 0.0 else 'below'} the show's origin"
        problem = f"stands {beside}, at most {PAD_HEIGHT_MAX_M:g} m is possible: check show_frame"
        findings.append(Finding(vehicle_id, problem))
    if distance_m > fence.distance_max_m:
        beyond = f"stands {distance_m:.0f} m from the show's origin, beyond the fence"
        problem = f"{beyond} at {fence.distance_max_m:g} m: check show_frame"
        findings.append(Finding(vehicle_id, problem))
    elif distance_m > pads_within_m:
        beyond = f"stands {distance_m:.0f} m from the show's origin, its autopilot's fence allows for"
        mend = "check show_frame, or raise operation.pads_within_m and apply the parameters again"
        findings.append(Finding(vehicle_id, f"{beyond} {pads_within_m:g} m: {mend}"))
    return findings


def _pads(
    vehicles: Sequence[VehicleId], fleet: FleetState, floor: Floor, uncertainty_m: Array
) -> list[Finding]:
    """Who stands too close to anybody, whether that one flies or not, to climb beside it."""
    kept_m = floor.horizontal_m + floor.margin_m
    place_m = fleet.position_m[:, :2]
    chosen = set(vehicles)
    flies = np.array([name in chosen for name in fleet.ids])
    rows = np.flatnonzero(flies)
    least_m = kept_m + uncertainty_m[rows][:, None] + uncertainty_m[None]
    distance_m = np.linalg.norm(place_m[rows][:, None] - place_m[None], axis=2)
    findings = []
    for at, other in np.argwhere(distance_m < least_m).tolist():
        row = int(rows[at])
        told_already = flies[other] and other < row
        if other != row and not told_already:
            problem = f"stands {distance_m[at, other]:.1f} m from {fleet.ids[other]}"
            findings.append(
                Finding(fleet.ids[row], f"{problem}, at least {least_m[at, other]:.3g} m is needed")
            )
    return findings
