"""The view of a whole site: the own vehicles, then those of the other stations."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.control import Tick
from gcs.flight.site_member import SiteMember
from gcs.flight.snapshots import finite
from gcs.model.state import Landed
from gcs.recording.mcap_layout import packed_state
from gcs.recording.sample import Elsewhere
from gcs.service import FleetView
from gcs.service.vehicle_table import VehicleTable
from gcs.stations.messages import MODES


def whole_view(own: FleetView, member: SiteMember, result: Tick) -> FleetView:
    """The same view with the vehicles of all stations. Those of silent stations keep their last values."""
    site, others = member.site, member.others
    rows = own.rows
    n, k = len(rows.ids), site.count
    now_s, unknown = own.time_s, np.full(k, np.nan)
    reported = site.reported(now_s)
    latitude_deg, longitude_deg, altitude_m = member.flight.config.frame.geodetic(others.position_m)
    airborne = others.airborne
    columns = member.columns()
    whole = VehicleTable(
        ids=[*rows.ids, *columns["ids"]],
        system_ids=[*rows.system_ids, *columns["system_ids"]],
        links=[*rows.links, *columns["links"]],
        autopilots=[*rows.autopilots, *columns["autopilots"]],
        phases=[*rows.phases, *columns["phases"]],
        reasons=[*rows.reasons, *columns["reasons"]],
        modes=[*rows.modes, *(MODES[code] for code in reported.modes.tolist())],
        armed=[*rows.armed, *reported.armed.tolist()],
        landed=[*rows.landed, *(Landed.IN_AIR if up else Landed.ON_GROUND for up in airborne.tolist())],
        ready=[*rows.ready, *reported.ready.tolist()],
        position_m=np.concatenate([rows.position_m, others.position_m]),
        velocity_m_s=np.concatenate([rows.velocity_m_s, others.velocity_m_s]),
        setpoint_m_s=np.concatenate([rows.setpoint_m_s, reported.setpoint_m_s]),
        yaw_rad=np.concatenate([rows.yaw_rad, reported.yaw_rad]),
        latitude_deg=np.concatenate([rows.latitude_deg, latitude_deg]),
        longitude_deg=np.concatenate([rows.longitude_deg, longitude_deg]),
        altitude_amsl_m=np.concatenate([rows.altitude_amsl_m, altitude_m]),
        battery_remaining=np.concatenate([rows.battery_remaining, reported.battery_remaining]),
        position_age_s=np.concatenate([rows.position_age_s, reported.age_s]),
        uncertainty_m=np.concatenate([rows.uncertainty_m, others.uncertainty_m]),
        heartbeat_age_s=np.concatenate([rows.heartbeat_age_s, reported.age_s]),
        link_quality=np.concatenate([rows.link_quality, reported.link_quality]),
        fix_type=np.concatenate([rows.fix_type, unknown]),
        limited_by=[*rows.limited_by, *[""] * k],
        colour=np.concatenate([rows.colour, np.zeros((k, 3), np.uint8)]),
        lit=np.concatenate([rows.lit, np.zeros(k, np.bool_)]),
        homes_m=[*rows.homes_m, *site.homes_m],
        stations=[*[site.own] * n, *columns["stations"]],
    )
    shown = site.shown
    table = whole if len(shown) == n + k else whole.of(shown)
    unknown = np.full(len(shown) - n, np.nan)
    changed: dict[str, Any] = {"rows": table, "stations": member.views(), "show": member.show}
    changed["bus"] = member.bus_view()
    changed["minimum_separation_m"] = finite(result.minimum_separation_m)
    if (found := own.estimates) is not None:  # of the own vehicles only
        low_s, empty_s = np.append(found.low_s, unknown), np.append(found.empty_s, unknown)
        changed["estimates"] = replace(found, low_s=low_s, empty_s=empty_s)
    return replace(own, **changed)


def recorded(member: SiteMember) -> Elsewhere:
    """The vehicles of the other stations for the flight data: a fraction of what their view costs."""
    site, others = member.site, member.others
    reported = site.reported(member.flight.fleet.time_s)
    columns: dict[str, NDArray[Any]] = {
        "yaw_rad": reported.yaw_rad,
        "position_age_s": reported.age_s,
        "position_uncertainty_m": others.uncertainty_m,
        "heartbeat_age_s": reported.age_s,
        "battery_remaining": reported.battery_remaining,
        "phase": site.phases,
        "mode": reported.modes,
        "landed": np.where(others.airborne, Landed.IN_AIR, Landed.ON_GROUND),
        "armed": reported.armed,
        "ready": reported.ready,
    }
    rows = packed_state(others.position_m, others.velocity_m_s, reported.setpoint_m_s, columns)
    return Elsewhere(site.ids, rows, member.reasons(), site.shown, member.show)
