"""Compares parameters with the requirements that make losing the ground station safe. Pure.

The requirements of each autopilot: `gcs.preflight.autopilots`.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cache
from math import inf, isfinite
from typing import Final

from gcs.config.schema import Config
from gcs.links import ParameterValue
from gcs.links.autopilots import Autopilot
from gcs.links.autopilots.versions import Version, Versions
from gcs.model.preflight_report import Check, State
from gcs.model.state import VehicleId
from gcs.preflight.autopilots import REQUIREMENTS
from gcs.preflight.requirement import Equipment, Requirement

MEND: Final = "to mend its parameters, stop the service and run: gcs params apply --config FILE"


class FleetRequirements:
    """The requirements of each vehicle: their heights of return, autopilots and versions differ.

    In a fleet of several autopilots those that must be `alike` leave no choice.
    """

    def __init__(self, config: Config) -> None:
        self.profiles: Mapping[VehicleId, Autopilot] = dict(
            zip(config.ids, (each for link in config.links for each in link.autopilots), strict=True)
        )
        stations = [link.station_id for link in config.links for _ in link.fleet]
        heights_m = config.return_heights_m.tolist()
        self._kinds = dict(zip(config.ids, zip(heights_m, stations, strict=True), strict=True))
        self._config = config
        site = config.site_rows
        several = len({profile.name for profile in self.profiles.values()}) > 1
        self._mixed = several or (site is not None and site.mixed)
        rid = config.remote_id
        top_m = inf if config.flight_site is None else config.flight_site.contingency_top_m
        self._equipment = Equipment(config.polygon_fence is not None, rid is not None and rid.require, top_m)
        self._made: dict[object, tuple[Requirement, ...]] = {}

    def of(self, vehicle_id: VehicleId, version: Version | None = None) -> tuple[Requirement, ...]:
        """Return those of a vehicle of that version; None: not known, so that names tell which it has."""
        profile, kind = self.profiles[vehicle_id], self._kinds[vehicle_id]
        possible = profile.versions.possible(version)
        key = profile.name, kind, possible
        if key not in self._made:
            config = self._config
            written = REQUIREMENTS[profile.name](config.operation, config.control, *kind, self._equipment)
            alike = (one.exactly if self._mixed and one.alike else one for one in written)
            each = (one.of_versions(profile.versions, possible) for one in alike)
            self._made[key] = tuple(one for one in each if one is not None)
        return self._made[key]


def requirements_of(config: Config) -> dict[VehicleId, tuple[Requirement, ...]]:
    """Return the requirements of each vehicle whose version is not known."""
    fleet = FleetRequirements(config)
    return {vehicle_id: fleet.of(vehicle_id) for vehicle_id in config.ids}


def settings_of(config: Config, versions: str = "") -> dict[str, ParameterValue | list[ParameterValue]]:
    """Return what `gcs params apply` would set, of simulated vehicles: a value of all, or one of each.

    Vehicles of another autopilot have any value of a parameter. `versions`: as `gcs sim --autopilot-version`.
    """
    fleet, of_each = FleetRequirements(config), []
    for vehicle_id, profile in fleet.profiles.items():
        version = profile.versions.recorded_or(versions)
        needed = (each for one in fleet.of(vehicle_id, version) for each in one.alternatives)
        of_each.append({one.name: one.set_to for one in needed if _is_set(one, profile.versions, version)})
    settings: dict[str, ParameterValue | list[ParameterValue]] = {}
    for name in dict.fromkeys(name for each in of_each for name in each):
        known = [each[name] for each in of_each if name in each]
        alike = len(set(known)) == 1
        settings[name] = known[0] if alike else [each.get(name, known[0]) for each in of_each]
    return settings


def _is_set(one: Requirement, versions: Versions, version: Version) -> bool:
    return not (one.is_absent or one.risk or versions.lacks(one.name, version))


def presumed_parameters(config: Config) -> dict[VehicleId, dict[str, ParameterValue]]:
    """Return the values that vehicles have which meet the requirements; none where these are not checked.

    What a version may lack with a risk is left out.
    """
    if not config.operation.require_parameters:
        return {}
    return {
        name: {one.name: one.set_to for one in needed if not one.lacking and not one.risk}
        for name, needed in requirements_of(config).items()
    }


def broken(
    needed: Sequence[Requirement], values: Mapping[str, ParameterValue]
) -> list[tuple[Requirement, ParameterValue | None]]:
    """Return the requirements that `values` do not meet, with the value; None if it is missing."""
    found = [requirement.of_values(values) for requirement in needed]
    return [(one, values.get(one.name)) for one in found if not one.risk and not one.is_met(values)]


def remaining_risks(needed: Sequence[Requirement], values: Mapping[str, ParameterValue]) -> list[str]:
    """Return what remains unsafe: this version lacks a parameter, or only its owner can set it."""
    found = [requirement.of_values(values) for requirement in needed]
    return [
        *(f"no {one.name}: {one.lacking}" for one in found if one.name not in values and one.lacking),
        *(f"{one.name} {one.risk}" for one in found if one.risk and not one.is_met(values)),
    ]


GROUPS: Final = {
    **dict.fromkeys(("MPC_", "WPNAV_", "WP_", "PILOT_", "PSC_", "ANGLE_", "ATC_"), "speed limits"),
    **dict.fromkeys(("GF_", "FENCE_", "AVOID_"), "own fence"),
}
"""Names of checks by prefix of the parameter; all others have the parameter's name."""

OTHERS: Final = "parameters"


def parameter_checks(
    needed: Sequence[Requirement],
    read: Mapping[str, ParameterValue] | None,
    problem: str | None,
    missing_to_do: str,
) -> list[Check]:
    """Return the parameter checks of one vehicle, with what fixes failures.

    A show needs no more than the service: its limits and its fence are within the service's. `read` is None
    while the values are not known, for the reason `problem` after a failed attempt. `missing_to_do` is for a
    parameter that is not there.
    """
    if read is None:
        text = f"parameters not read yet{f': {problem}' if problem else '; it is being asked'}"
        to_do = f"wait; if it stays so, {missing_to_do}" if problem else "wait"
        return [Check(OTHERS, State.UNKNOWN, limit=f"{len(needed)} hold", problem=text, to_do=to_do)]
    checks = [_wrong(requirement, value, missing_to_do) for requirement, value in broken(needed, read)]
    wrong = {check.name for check in checks}
    for name, count in Counter(group_of(requirement.name) for requirement in needed).items():
        if name not in wrong:
            checks.append(Check(name, State.PASS, count, "parameters", f"{count} hold"))
    return checks


@cache
def group_of(name: str) -> str:
    return next((group for start, group in GROUPS.items() if name.startswith(start)), OTHERS)


def _wrong(requirement: Requirement, value: ParameterValue | None, missing_to_do: str) -> Check:
    found = "not there" if value is None else f"{value:g}"
    return Check(
        group_of(requirement.name),
        State.FAIL,
        None if value is None or not isfinite(value) else float(value),
        requirement.unit,
        f"{requirement.name}: {requirement.desired}",
        f"{requirement.name} is {found}, {requirement.desired} is needed ({requirement.why})",
        missing_to_do if value is None else MEND,
    )
