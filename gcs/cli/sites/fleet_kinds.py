"""What of a configuration's fleet decides how large its volumes must be, one kind for each autopilot."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from gcs.areas.site import AreaKind, FlightSite
from gcs.areas.volumes import FleetKind, GroundReach, Volumes, authority_volumes, fleet_volumes
from gcs.config import yaml_files
from gcs.config.schema import Config
from gcs.links import ParameterValue
from gcs.links.autopilots import Autopilot
from gcs.model.errors import ConfigError
from gcs.model.state import VehicleId
from gcs.preflight.parameters import presumed_parameters
from gcs.safety.impact import ImpactSettings, impacts

TILTS: Final = {"MPC_TILTMAX_AIR": 1.0, "ATC_ANGLE_MAX": 1.0, "ANGLE_MAX": 0.01}
"""Parameters that limit the tilt, and degrees of their unit."""

TILT_DEG: Final = 45.0
FIX_3D: Final = 3

ReadParameters = Mapping[VehicleId, Mapping[str, ParameterValue]]


def read_parameters(name: str | None) -> dict[VehicleId, dict[str, ParameterValue]]:
    """The values in the output of `gcs params check --json`; empty without a file. Raises: ConfigError."""
    if name is None:
        return {}
    needed = "the output of gcs params check --config CONFIG --json is needed"
    try:
        rows = json.loads(yaml_files.read(Path(name)))["rows"]
        named = [(str(row["vehicle"]), str(row["parameter"]), row["value"]) for row in rows]
    except (ValueError, TypeError, KeyError, RecursionError):
        raise ConfigError(f"{name}: {needed}") from None
    values: dict[VehicleId, dict[str, ParameterValue]] = {}
    for vehicle, parameter, value in named:
        if isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value):
            values.setdefault(vehicle, {})[parameter] = value
    return values


def ground_reach(settings: ImpactSettings, climbs_m_s: tuple[float, ...]) -> GroundReach:
    """How far from its place a vehicle may fall, whatever height up to that it has, and however it climbs."""

    def reach_m(height_m: float, speed_m_s: float) -> float:
        heights = np.linspace(0.0, height_m, 9)
        cases = np.array([(high, climb) for high in heights.tolist() for climb in climbs_m_s])
        position_m, velocity_m_s = np.zeros((len(cases), 3)), np.zeros((len(cases), 3))
        position_m[:, 2], velocity_m_s[:, 0], velocity_m_s[:, 2] = -cases[:, 0], speed_m_s, -cases[:, 1]
        falls = impacts(position_m, velocity_m_s, settings)
        return float((np.abs(falls.place_m[:, 0]) + falls.spread_m).max())

    return reach_m


def fleet_kinds(config: Config, read: ReadParameters) -> list[FleetKind]:
    """One for each autopilot, the most demanding values of its vehicles; `read` are parameters as read."""
    profiles = dict(zip(config.ids, (each for link in config.links for each in link.autopilots), strict=True))
    named = {profile.name: profile for profile in profiles.values()}
    return [
        _kind(config, profile, [name for name in config.ids if profiles[name] is profile], read)
        for profile in named.values()
    ]


def _kind(config: Config, profile: Autopilot, ids: list[VehicleId], read: ReadParameters) -> FleetKind:
    operation, safety, presumed = config.operation, config.control.safety, presumed_parameters(config)
    each_of = [dict(read.get(name) or presumed.get(name, {})) for name in ids]
    losses = [
        profile.without_setpoints(operation.setpoint_loss_action, operation.setpoint_loss_s, values)
        for values in each_of
    ]
    fastest_m_s = safety.limits.horizontal_m_s
    loss = max(losses, key=lambda each: each.flies_on_s + each.stop_s(fastest_m_s))
    tilts = [_tilt_deg(values) for values in each_of]
    as_read = "as read" if any(name in read for name in ids) else "as demanded"
    response = min((profile.response(values) for values in each_of), key=lambda each: each.acceleration_m_s2)
    error_m = float(config.positioning.least_by_type_m[FIX_3D])
    return FleetKind(
        autopilot=profile.title,
        vehicles=len(ids),
        speed_m_s=fastest_m_s,
        climb_m_s=safety.limits.up_m_s,
        dimension_m=safety.impact.falling.dimension_m,
        tilt_deg=min(tilts),
        tilt_source=f"greatest tilt, {as_read}",
        setpoint_timeout_s=config.setpoint_timeout_s,
        loss=loss,
        loss_source=f"without setpoints, parameters {as_read}",
        fence_period_s=profile.fence.checked_s,
        reaction_s=max(safety.braking.reaction_s, response.swings_s) + safety.link_delay_s,
        deceleration_m_s2=min(safety.braking.deceleration_m_s2, response.acceleration_m_s2),
        error_m=error_m,
        error_source="positioning, of a 3D fix",
        wind_m_s=safety.impact.wind_max_m_s,
    )


def _tilt_deg(values: Mapping[str, ParameterValue]) -> float:
    degrees = [per_unit * float(values[name]) for name, per_unit in TILTS.items() if name in values]
    return min((each for each in degrees if each > 0.0), default=TILT_DEG)


def volumes_of(config: Config, read: ReadParameters) -> list[Volumes]:
    """Both computations for each autopilot of a configuration with a site, as high as the site draws it."""
    if config.flight_site is None:
        return []
    drawn = config.flight_site.of(AreaKind.CONTINGENCY)
    return _volumes(config, config.flight_site, read, max((area.top_m for area in drawn), default=0.0))


def volumes_to_derive(config: Config, site: FlightSite, read: ReadParameters) -> list[Volumes]:
    """Both as `derived` needs them: from the top of the contingency volume that it draws."""
    rise_m = max(each.contingency_height.value_m for each in _volumes(config, site, read, 0.0))
    return _volumes(config, site, read, site.flight_geography.top_m + rise_m)


def _volumes(
    config: Config, site: FlightSite, read: ReadParameters, contingency_top_m: float
) -> list[Volumes]:
    limits, impact = config.control.safety.limits, config.control.safety.impact
    reach = ground_reach(impact, (-limits.down_m_s, 0.0, limits.up_m_s))
    top_m = min(site.flight_geography.top_m, config.control.safety.fence.height_max_m)
    computed: list[Volumes] = []
    for kind in fleet_kinds(config, read):
        computed += [
            authority_volumes(kind, top_m, contingency_top_m),
            fleet_volumes(kind, top_m, reach, contingency_top_m),
        ]
    return computed


def volumes_document(volumes: Volumes) -> dict[str, Any]:
    """A computation as `--json` has it."""
    return {
        "method": volumes.method,
        "autopilot": volumes.autopilot,
        "extents": [
            {
                "what": extent.what,
                "value_m": round(extent.value_m, 2),
                "terms": [
                    {
                        "name": term.name,
                        "value_m": round(term.value_m, 2),
                        "formula": term.formula,
                        "source": term.source,
                    }
                    for term in extent.terms
                ],
            }
            for extent in volumes.extents
        ],
    }
