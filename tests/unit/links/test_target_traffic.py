"""All traffic out of MAVLink and Cursor on Target: every track but the own vehicles, with what it is."""

from math import isnan

import pytest
from pymavlink.dialects.v20 import common

from gcs.links.targets.cot import CotTraffic
from gcs.links.targets.traffic import QUIET_S, TrafficReports
from gcs.model.target_fix import TargetFix
from tests.support.target_bytes import cot
from tests.support.target_fakes import aircraft, packed, position, vessel

OWN = frozenset({7})


def taken(*datagrams: bytes) -> list[TargetFix]:
    reports = TrafficReports("udp://0.0.0.0:14560", OWN, 0.0)
    return [fix for datagram in datagrams for fix in reports.take(datagram, 1.0)]


def heartbeat(kind: int) -> common.MAVLink_heartbeat_message:
    return common.MAVLink_heartbeat_message(kind, 3, 0, 0, 4, 3)


def test_every_track_has_its_name_and_kind() -> None:
    drone = aircraft(0xABCDEF)
    drone.emitter_type = common.ADSB_EMITTER_TYPE_UAV
    fixes = taken(packed(aircraft(), drone, vessel()), packed(position(), system_id=9))
    assert [(fix.track, fix.kind) for fix in fixes] == [
        ("4CA1B2", "manned"), ("ABCDEF", "unmanned"), ("211234560", "vessel"), ("system 9", "unmanned"),
    ]  # fmt: skip
    assert fixes[0].source_s == 0.0, "received a second ago"


def test_heartbeat_says_what_a_system_is() -> None:
    (fix,) = taken(packed(heartbeat(common.MAV_TYPE_SURFACE_BOAT), position(), system_id=9))
    assert fix.kind == "vessel"


def test_own_vehicles_are_no_traffic() -> None:
    assert taken(packed(position(), system_id=7)) == []
    assert len(taken(packed(aircraft(), system_id=7))) == 1, "what their receiver reports is"


def test_vessel_at_anchor_is_believed_between_its_reports() -> None:
    (fix,) = taken(packed(vessel(age_s=185)))
    assert (fix.kind, fix.source_s) == ("vessel", -184.0)


@pytest.mark.parametrize(
    "message", [aircraft(flags=0), aircraft(age_s=61), vessel(age_s=201), position(latitude=2**31 - 1)]
)
def test_report_without_a_place_is_named(message: object) -> None:
    reports = TrafficReports("udp://0.0.0.0:14560", OWN, 0.0)
    assert reports.take(packed(message, system_id=9), 1.0) == []
    assert reports.why_silent(2.5)


def test_silence_is_named_and_a_heartbeat_ends_it() -> None:
    reports = TrafficReports("udp://0.0.0.0:14560", OWN, 0.0)
    assert reports.why_silent(QUIET_S - 0.1) == ""
    assert reports.why_silent(QUIET_S + 1.0) == "nothing arrives at udp://0.0.0.0:14560"
    reports.take(packed(heartbeat(common.MAV_TYPE_ADSB), system_id=9), QUIET_S + 1.5)
    assert reports.why_silent(QUIET_S + 3.0) == ""


@pytest.mark.parametrize(
    ("type_of_event", "kind"),
    [
        ("a-f-A-M-F-Q", "unmanned"), ("a-n-A-C-F", "manned"), ("a-f-S", "vessel"), ("a-h-G-E-V", "ground"),
        ("a-u", "manned"),
    ],
)  # fmt: skip
def test_every_event_is_a_track_by_its_uid(type_of_event: str, kind: str) -> None:
    (fix,) = CotTraffic().take(cot("UID-1", "EAGLE", type=type_of_event), 1.0)
    assert (fix.track, fix.kind) == ("UID-1", kind)
    assert isnan(fix.altitude_amsl_m), "above the ellipsoid, and where the geoid is was not said"
