"""Compares parameters with the requirements that make losing the ground station safe. Pure.

The requirements of each autopilot: `gcs.preflight.autopilots`.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cache
from math import isfinite
from typing import Final

from gcs.config.schema import Config
from gcs.links import ParameterValue
from gcs.model.preflight_report import Check, State
from gcs.model.state import VehicleId
from gcs.preflight.autopilots import REQUIREMENTS
from gcs.preflight.requirement import Requirement

MEND: Final = "to mend its parameters, stop the service and run: gcs params apply --config FILE"


def requirements_of(config: Config) -> dict[VehicleId, tuple[Requirement, ...]]:
    """Return the requirements of each vehicle: their heights of return and their autopilots differ.

    In a fleet of several autopilots those that must be `alike` leave no choice.
    """
    kinds = [(profile.name, link.station_id) for link in config.links for profile in link.autopilots]
    site = config.site_rows
    mixed = (site is not None and site.mixed) or len({name for name, _ in kinds}) > 1
    made: dict[tuple[tuple[str, int], float], tuple[Requirement, ...]] = {}
    for kind, height_m in (alike := [*zip(kinds, config.return_heights_m.tolist(), strict=True)]):
        if (kind, height_m) not in made:
            name, station_id = kind
            needed = REQUIREMENTS[name](config.operation, config.control, height_m, station_id)
            made[kind, height_m] = tuple(one.exactly if mixed and one.alike else one for one in needed)
    return dict(zip(config.ids, map(made.__getitem__, alike), strict=True))


def settings_of(config: Config) -> dict[str, ParameterValue | list[ParameterValue]]:
    """Return what `gcs params apply` would set, of simulated vehicles: a value of all, or one of each.

    Vehicles of another autopilot have any value of a parameter. What a version may lack is left out.
    """
    of_each = [
        {one.name: one.set_to for one in needed if one.lacking is None}
        for needed in requirements_of(config).values()
    ]
    settings: dict[str, ParameterValue | list[ParameterValue]] = {}
    for name in dict.fromkeys(name for each in of_each for name in each):
        known = [each[name] for each in of_each if name in each]
        alike = len(set(known)) == 1
        settings[name] = known[0] if alike else [each.get(name, known[0]) for each in of_each]
    return settings


def presumed_parameters(config: Config) -> dict[VehicleId, dict[str, ParameterValue]]:
    """Return the values that vehicles have which meet the requirements; none where these are not checked."""
    if not config.operation.require_parameters:
        return {}
    return {
        name: {one.name: one.set_to for one in needed if one.lacking is None}
        for name, needed in requirements_of(config).items()
    }


def broken(
    needed: Sequence[Requirement], values: Mapping[str, ParameterValue]
) -> list[tuple[Requirement, ParameterValue | None]]:
    """Return the requirements that `values` do not meet, with the value; None if it is missing."""
    found = [requirement.of_version(values) for requirement in needed]
    return [
        (one, values.get(one.name))
        for one in found
        if (one.lacking is None if one.name not in values else not one.holds(values[one.name]))
    ]


def remaining_risks(needed: Sequence[Requirement], values: Mapping[str, ParameterValue]) -> list[str]:
    """Return what remains unsafe because this version of the autopilot lacks a parameter."""
    found = [requirement.of_version(values) for requirement in needed]
    return [f"no {one.name}: {one.lacking}" for one in found if one.name not in values and one.lacking]


GROUPS: Final = {
    **dict.fromkeys(("MPC_", "WPNAV_", "PILOT_", "PSC_", "ANGLE_"), "speed limits"),
    **dict.fromkeys(("GF_", "FENCE_", "AVOID_"), "own fence"),
}
"""Names of checks by prefix of the parameter; all others have the parameter's name."""

OTHERS: Final = "parameters"


def parameter_checks(
    needed: Sequence[Requirement], read: Mapping[str, ParameterValue] | None, problem: str | None
) -> list[Check]:
    """Return the parameter checks of one vehicle, with the command that fixes failures.

    A show needs no more than the service: its limits and its fence are within the service's. `read` is None
    while the values are not known, for the reason `problem` after a failed attempt.
    """
    if read is None:
        text = f"parameters not read yet{f': {problem}' if problem else '; it is being asked'}"
        return [Check(OTHERS, State.UNKNOWN, limit=f"{len(needed)} hold", problem=text, to_do="wait")]
    checks = [_wrong(requirement, value) for requirement, value in broken(needed, read)]
    wrong = {check.name for check in checks}
    for name, count in Counter(group_of(requirement.name) for requirement in needed).items():
        if name not in wrong:
            checks.append(Check(name, State.PASS, count, "parameters", f"{count} hold"))
    return checks


@cache
def group_of(name: str) -> str:
    return next((group for start, group in GROUPS.items() if name.startswith(start)), OTHERS)


def _wrong(requirement: Requirement, value: ParameterValue | None) -> Check:
    found = "not there" if value is None else f"{value:g}"
    return Check(
        group_of(requirement.name),
        State.FAIL,
        None if value is None or not isfinite(value) else float(value),
        "",
        f"{requirement.name}: {requirement.desired}",
        f"{requirement.name} is {found}, {requirement.desired} is needed ({requirement.why})",
        MEND,
    )
