"""The verdict on a SITL flight, from the simulators' true states."""

from dataclasses import replace

import numpy as np

from gcs.cli.demo import demo_report as report
from gcs.config import schema as configuration
from gcs.model.state import Array
from tests.sitl.sitl_flight import TRUE_WITHIN_S, Account, Stall, Window
from tests.sitl.sitl_truth import GroundTruthRecorder

ENERGY_MAX, NEAREST_MIN = 1.003, 0.9
CENTER_MAX_M = 2.0
"""From the commanded centre to that of the sphere through the vehicles: a real ArduCopter flies 4.7 % low."""

APART_MAX_M = 2.0
"""Between the heights of several autopilots, each against the truth: PX4's barometer is not 4.7 % low."""

ERROR_MAX_M = 3.0
"""From where a vehicle is to where it reports to be, on the mean: more is no noise of a 3D fix."""

UP = np.array([0.0, 0.0, -1.0])

SLOWEST = 0.98


def judge(recorder: GroundTruthRecorder, account: Account, config: configuration.Config) -> dict[str, object]:
    """The figures of the flight; `verdict` is kept or broken. Raises: ValueError without true states."""
    truth, commanded = recorder.truth(config.frame), account.commanded()
    smallest_m, violations = report.separation(truth, config.control.safety.floor)
    ids, lost = config.ids, account.lost
    landed = [name for name, down in zip(ids, truth.landed_at_end, strict=True) if down and name not in lost]
    figures: dict[str, object] = {
        "flown": account.flown,
        "not_flown": account.not_flown,
        "lost": lost,
        "landed": len(landed),
        "min_separation_m": round(smallest_m, 3) if np.isfinite(smallest_m) else None,
        "separation_violations": violations,
    }
    broken = list(account.failures)
    if len(landed) + len(lost) != len(ids):
        broken.append("not every vehicle landed")
    if violations:
        broken.append("a pair came inside the minimum separation")
    for name, window in account.steady.items():
        if commanded is None or not window.vehicles:
            broken.append(f"no formation flew: {name}")
            continue
        shape, wrong = _shape(truth, account, window, ids, commanded)
        figures |= {f"{what}_{name}": round(value, 5) for what, value in shape.items()}
        broken += [f"{what}: {name}" for what in wrong]
    penetrations = 0
    if account.obstacle is not None:
        penetrations = report.penetrations(truth.between(*account.obstacle_s), account.obstacle)
    if penetrations:
        broken.append("a vehicle came inside the obstacle")
    broken += [
        f"the phase was not true within {TRUE_WITHIN_S:g} s of the stall: {each.when}"
        for each in account.stalls
        if each.true_s is None or each.true_s > TRUE_WITHIN_S
    ]
    per_wall = recorder.simulated_per_wall_s()
    return figures | {
        "obstacle_penetrations": penetrations,
        **_of_stalls(account.stalls),
        "recovered_after_restart_s": _rounded(account.recovered_after_restart_s),
        "commands_refused": account.refused,
        "simulated_per_wall_s": None if per_wall is None else round(per_wall, 3),
        "machine_fast_enough": None if per_wall is None else per_wall >= SLOWEST,
        "broken": broken,
        "verdict": "broken" if broken else "kept",
    }


def _of_stalls(stalls: list[Stall]) -> dict[str, object]:
    """The worst times, and the last phase."""

    def worst(times: list[float | None]) -> float | None:
        known = [each for each in times if each is not None]
        return _rounded(max(known)) if known and len(known) == len(times) else None

    return {
        "stalls": len(stalls),
        "phase_after_stall": stalls[-1].phase if stalls else "",
        "true_after_stall_s": worst([each.true_s for each in stalls]),
        "recovered_after_stall_s": worst([each.recovered_s for each in stalls]),
    }


def _shape(
    truth: report.GroundTruth,
    account: Account,
    window: Window,
    ids: tuple[str, ...],
    commanded: report.Commanded,
) -> tuple[dict[str, float], list[str]]:
    """The figures of a steady window, and what is wrong with them."""
    rows = [row for row, vehicle in enumerate(ids) if vehicle in window.vehicles]
    flown = _of(truth.between(window.start_s, window.end_s), rows)
    off_m = reported_off_m(account, window, flown, [ids[row] for row in rows])
    lower_m = by_autopilot(-off_m[:, 2], [account.autopilots[ids[row]] for row in rows])
    shape = report.shape(_moved(flown, lower_m[:, None] * UP), commanded)
    apart_m, worst_m = float(np.ptp(lower_m)), float(np.nanmax(np.linalg.norm(off_m, axis=1), initial=0.0))
    wrong = []
    if shape["energy_ratio"] > ENERGY_MAX or shape["nearest_ratio"] < NEAREST_MIN:
        wrong.append("the shape was not reached")
    if shape["center_error_m"] > CENTER_MAX_M:
        wrong.append(f"the formation was {shape['center_error_m']:.1f} m beside its centre")
    if apart_m > APART_MAX_M:
        wrong.append(f"the autopilots' heights were {apart_m:.1f} m apart")
    if worst_m > ERROR_MAX_M:
        wrong.append(f"a vehicle was {worst_m:.1f} m from where it reported")
    return shape | {"heights_apart_m": apart_m, "position_error_m": worst_m}, wrong


def reported_off_m(account: Account, window: Window, truth: report.GroundTruth, ids: list[str]) -> Array:
    """(n, 3) by how much the mean of what each vehicle reports is beside its true mean; NaN: unknown."""
    reported_m = np.array([account.reported_m(vehicle, window) for vehicle in ids])
    off_m: Array = reported_m - truth.position_m.mean(axis=0)
    return off_m


def by_autopilot(off_m: Array, kinds: list[str]) -> Array:
    """(n,) the mean of `off_m` (n,) of each autopilot's vehicles.

    In a fleet of one autopilot that is 0: what all have in common is the centre's error.
    """
    if len(set(kinds)) == 1:
        return np.zeros(len(kinds))
    return np.array([np.nanmean(off_m[[other == kind for other in kinds]]) for kind in kinds])


def _moved(truth: report.GroundTruth, by_m: Array) -> report.GroundTruth:
    """The same with each vehicle moved by (n, 3)."""
    return replace(truth, position_m=truth.position_m + np.nan_to_num(by_m))


def _of(truth: report.GroundTruth, rows: list[int]) -> report.GroundTruth:
    """Some of the vehicles."""
    return report.GroundTruth(
        truth.time_s, truth.position_m[:, rows], truth.airborne[:, rows], truth.landed_at_end[rows]
    )


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 2)
