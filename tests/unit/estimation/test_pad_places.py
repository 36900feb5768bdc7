"""Where vehicles stand once they are ready, and how far they are reported from there."""

from dataclasses import replace
from typing import Any, Final

import numpy as np
import pytest

from gcs.estimation.pad_places import PERIOD_S, SETTLES_S, PadPlaces
from gcs.links.autopilots import AUTOPILOTS
from gcs.links.telemetry import FleetTelemetry
from gcs.model.frames import ShowFrame
from gcs.model.state import Landed, Telemetry
from tests.support.reported import reported
from tests.support.tlog_files import frames, read

UP_SHARE: Final = 2.0
RTK_M, SINGLE_M = 0.05, 1.0


class Stood:
    """One vehicle on a pad, sample by sample."""

    def __init__(self, deviation_m: float = RTK_M) -> None:
        self.places, self.deviation_m = PadPlaces(1, UP_SHARE), deviation_m
        self.at_m, self.now_s = np.zeros(3), 0.0

    def stand(self, seconds: float, **columns: Any) -> bool:
        """Returns: whether it has moved."""
        given: dict[str, Any] = {
            "ready": (True,),
            "armed": (False,),
            "landed": (Landed.ON_GROUND,),
            "fix_type": 6.0,
        }
        now: Telemetry = reported(["d1"], **(given | columns))
        for _ in range(round(seconds / PERIOD_S)):
            self.now_s += PERIOD_S
            wide_m = np.array([self.deviation_m])
            self.places.note(now, self.at_m[None].copy(), np.ones(1, np.bool_), wide_m, self.now_s)
        return bool(np.isfinite(self.places.found.since_s[0]))


@pytest.mark.keeps("1.0-30.0")
@pytest.mark.parametrize(("deviation_m", "north_m"), [(RTK_M, 1.2), (SINGLE_M, 4.4), (SINGLE_M, 30.0)])
def test_a_jump_beyond_the_accuracy_stays_for_an_hour(deviation_m: float, north_m: float) -> None:
    stood = Stood(deviation_m)
    assert not stood.stand(20.0)
    stood.at_m[0] += north_m
    assert stood.stand(3600.0)
    assert stood.places.found.by_m[0, 0] == pytest.approx(north_m)
    assert stood.places.found.since_s[0] == pytest.approx(20.0 + PERIOD_S)


@pytest.mark.keeps("1.0-4.0")
@pytest.mark.parametrize(("deviation_m", "north_m"), [(RTK_M, 0.8), (SINGLE_M, 4.0)])
def test_what_the_accuracy_explains_is_no_jump(deviation_m: float, north_m: float) -> None:
    stood = Stood(deviation_m)
    stood.stand(20.0)
    stood.at_m[0] += north_m
    assert not stood.stand(3600.0)


def test_height_that_follows_the_weather_is_no_jump_a_step_is() -> None:
    stood = Stood()
    stood.stand(20.0)
    for _ in range(900):
        stood.at_m[2] -= 8.0 / 3600.0  # 1 hPa in an hour
        assert not stood.stand(1.0)
    stood.at_m[2] -= 1.5
    assert stood.stand(600.0)


@pytest.mark.parametrize(
    "starts", [{"ready": (False,)}, {"fix_type": 2.0}, {"landed": (Landed.UNKNOWN,)}], ids=str
)
def test_until_it_was_ready_it_stands_nowhere(starts: dict[str, Any]) -> None:
    stood = Stood()
    stood.stand(60.0, **starts)
    stood.at_m[0] += 30.0
    assert not stood.stand(60.0)


def test_a_jump_while_readiness_lacks_is_found_later() -> None:
    stood = Stood()
    stood.stand(20.0)
    stood.at_m[0] += 30.0
    assert stood.stand(5.0, ready=(False,), fix_type=1.0)


@pytest.mark.parametrize(
    "since", [{"reboot_count": (1,)}, {"armed": (True,), "landed": (Landed.IN_AIR,)}], ids=str
)
def test_restart_and_flight_begin_anew(since: dict[str, Any]) -> None:
    stood = Stood()
    stood.stand(20.0)
    stood.at_m[0] += 30.0
    assert stood.stand(5.0)
    assert not stood.stand(PERIOD_S, **since)
    assert not stood.stand(60.0, **{key: since[key] for key in since if key == "reboot_count"})


def test_arming_on_the_ground_forgives_nothing() -> None:
    stood = Stood()
    stood.stand(20.0)
    stood.at_m[0] += 30.0
    assert stood.stand(5.0, armed=(True,))
    assert stood.stand(60.0)


def test_back_in_place_it_must_be_steady_first() -> None:
    stood = Stood()
    stood.stand(20.0)
    stood.at_m[0] += 30.0
    stood.stand(60.0)
    stood.at_m[0] -= 30.0
    assert stood.stand(SETTLES_S - 1.0)
    assert not stood.stand(2.0)


def test_a_place_of_a_poor_fix_is_taken_anew_with_a_better() -> None:
    stood = Stood(SINGLE_M)
    stood.stand(20.0)
    stood.at_m[0], stood.deviation_m = 3.0, RTK_M
    assert not stood.stand(60.0)
    stood.at_m[0] = 0.0
    assert stood.stand(1.0)


def test_a_recorded_boot_of_arducopter_is_held_against_none() -> None:
    """FACTS-ARDUPILOT, 19: it uses its receiver from 39.5 s on, is ready then, and flies from 57 s on."""
    fleet, places, stood_m = FleetTelemetry(["d1"], [AUTOPILOTS["ardupilot"]]), PadPlaces(1, UP_SHARE), []
    frame, due_s = ShowFrame(-35.363262, 149.165237, 488.0, 0.0), 0.0
    for time_s, each in frames("ardupilot/session.tlog.xz"):
        read(fleet, time_s, each)
        if time_s < due_s:
            continue
        due_s, now = time_s + PERIOD_S, replace(fleet.telemetry(), ready=(time_s > 39.5,))
        position_m = frame.position_m(now.latitude_deg, now.longitude_deg, now.altitude_amsl_m)
        fresh = np.array([time_s - now.position_time_s[0] < 1.0])
        places.note(now, position_m, fresh, np.array([RTK_M]), time_s)
        assert np.isinf(places.found.since_s[0])
        stood_m.append(places.found.by_m[0, 0])
    assert 0.0 < np.nanmax(stood_m) < 0.1, "it stood at its place"
