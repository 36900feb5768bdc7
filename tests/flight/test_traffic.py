"""Traffic in flight: it is announced and evaded, and a manned aircraft has the formation give way."""

from dataclasses import replace
from math import inf, isfinite, nan
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

from gcs.failsafe.policy import Cause
from gcs.flight.features.traffic import ALARMS_MAX, OtherTraffic
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Formation
from gcs.model.target_fix import TargetFix
from gcs.model.traffic import TRACK_KINDS, TrackKind
from gcs.recording.flight_report import make_flight_report
from gcs.recording.mcap_reader import FlightData, Standard
from gcs.recording.session import Record
from gcs.recording.trajectories import estimated
from gcs.service import ShowAction
from gcs.service.alarms import AlarmAction, AlarmCause, AlarmSeverity
from gcs.testing.virtual_show import VirtualShow, fly, show_config
from tests.support import written_show
from tests.support.failsafe_flights import failsafe, reacts
from tests.support.show_phases import paused, running

RADIUS_M = 15.0
TRAFFIC = {
    "traffic": {
        "sources": [{"kind": "mavlink", "at": "udp://127.0.0.1:14999"}],
        "own": ["0000AA"],
        "radius_m": RADIUS_M,
        "manned": {"radius_m": 200, "height_m": 50},
    }
}
FOUR = show_config(4, **TRAFFIC)
NUMBERS = (
    "altitude_amsl_m", "north_m_s", "east_m_s", "down_m_s", "deviation_m", "height_deviation_m",
    "velocity_deviation_m_s", "source_s",
)  # fmt: skip


def traffic_of(show: VirtualShow) -> OtherTraffic:
    (found,) = [each for each in show.service.flight.features if isinstance(each, OtherTraffic)]
    return found


def report(
    show: VirtualShow,
    x_m: float,
    *,
    kind: TrackKind = "unmanned",
    speed_m_s: float = 0.0,
    height_m: float = 20.0,
    name: str = "4CA1B2",
    down_m_s: float = 0.0,
    pressure_altitude_m: float = nan,
) -> None:
    """Report a track on the show's x axis, as a receiver would."""
    latitude_deg, longitude_deg, altitude_m = show.config.frame.geodetic(np.array([[x_m, 0.0, -height_m]]))
    place = float(latitude_deg[0]), float(longitude_deg[0]), float(altitude_m[0])
    north_m_s, east_m_s, _ = show.config.frame.into_ned(np.array([speed_m_s, 0.0, 0.0])).tolist()
    fix = TargetFix(show.now_s, *place, north_m_s, east_m_s, down_m_s, 3.0, 3.0, 0.5, nan, name, kind)
    if isfinite(pressure_altitude_m):
        fix = replace(fix, altitude_amsl_m=nan, pressure_altitude_m=pressure_altitude_m)
    traffic_of(show).take(0, fix)


def alarms(show: VirtualShow, *, lasting: bool = False) -> set[AlarmCause]:
    return {alarm.cause for alarm in show.service.alarms.alarms if alarm.lasts or not lasting}


@pytest.mark.soak
def test_drone_that_crosses_is_announced_and_evaded() -> None:
    async def story(show: VirtualShow) -> None:
        closest_m, announced_m = np.inf, nan
        for second in range(28):
            x_m = -250.0 + 15.0 * second
            report(show, x_m, speed_m_s=15.0, height_m=float(show.service.plan.current.formation.height_m))
            for tenth in range(10):
                await show.wait(0.1)
                there_m = x_m + 1.5 * tenth
                place_m = show.true_m
                closest_m = min(closest_m, float(np.hypot(place_m[:, 0] - there_m, place_m[:, 1]).min()))
            if np.isnan(announced_m) and AlarmCause.TRAFFIC_NEAR in alarms(show):
                announced_m = -x_m
        assert announced_m > 200.0
        assert closest_m > RADIUS_M
        assert show.view.show is ShowPhase.RUNNING
        assert show.floor_violations() == 0

    fly(story, FOUR, after=running)


@pytest.mark.soak
def test_report_has_how_near_a_track_came(tmp_path: Path) -> None:
    """Of that which came near only."""
    vehicles = {name: (row + 1, "loop") for row, name in enumerate(FOUR.ids)}

    async def story(show: VirtualShow) -> float:
        closest_m = inf
        await show.start()
        await show.wait(15.0)
        height_m = float(show.service.plan.current.formation.height_m)
        for second in range(30):
            report(show, -250.0 + 15.0 * second, speed_m_s=15.0, height_m=height_m + 2.0)
            report(show, 2000.0, kind="vessel", name="FAR", height_m=0.0)
            await show.wait(1.0)
            off_m = show.true_m[:, :2] - [-235.0 + 15.0 * second, 0.0]
            closest_m = min(closest_m, float(np.hypot(*off_m.T).min()))
        return closest_m

    with Record(tmp_path, FOUR.model_dump_json(), vehicles) as record:
        closest_m = fly(story, FOUR, record=record)
    data = FlightData(record.folder / "flight.mcap")
    flown = estimated(data)
    (passed,) = flown.traffic
    assert (passed.track, passed.kind) == ("4CA1B2", "unmanned")
    assert passed.vehicle in FOUR.ids
    assert RADIUS_M < passed.sideways_m < closest_m + 3.0
    assert passed.outside_m == pytest.approx(passed.sideways_m - RADIUS_M, abs=0.11)
    assert passed.above_m == pytest.approx(2.0, abs=11.0), "of the vehicle, which is anywhere on the sphere"
    body = make_flight_report(flown, Standard.of(data.about.config, "it")).report("it")
    assert body.traffic == flown.traffic
    assert f"{passed.vehicle} was nearest, {passed.outside_m:g} m outside its cylinder" in passed.text


def test_manned_aircraft_has_the_formation_descend() -> None:
    async def story(show: VirtualShow) -> None:
        show.service.plan.set_formation(Formation(10.0, 40.0))
        await show.wait(15.0)
        report(show, 150.0, kind="manned", height_m=60.0)
        reported = await reacts(show, Cause.MANNED_AIRCRAFT)
        assert reported.action == "descend"
        await show.wait(1.0)
        (alarm,) = [each for each in show.view.alarms if each.cause is AlarmCause.TRAFFIC_MANNED]
        assert alarm.action is AlarmAction.STOP
        assert "The formation flies on lower, and stays there." in alarm.text
        assert show.view.reason.startswith("flies lower: manned aircraft 4CA1B2 is near; ")
        assert show.service.plan.current.formation.height_m == pytest.approx(15.0, abs=1.0)
        for _ in range(30):
            report(show, 150.0, kind="manned", height_m=60.0)
            await show.wait(1.0)
            if -show.true_m[:, 2].min() < 27.0:
                break
        assert -show.true_m[:, 2].min() < 27.0
        await show.until(lambda: failsafe(show, Cause.MANNED_AIRCRAFT) is None)
        assert show.service.plan.current.formation.height_m < 20.0, "an operator raises it again"

    fly(story, FOUR, after=running)


@pytest.mark.soak
def test_manned_aircraft_that_has_passed_is_near_no_more() -> None:
    """It says so first; one that turns, or goes away slowly, stays an emergency."""

    async def story(show: VirtualShow) -> tuple[list[str], set[AlarmCause], set[AlarmCause]]:
        texts = []
        for second in range(26):
            report(show, -90.0 + 10.0 * second, kind="manned", speed_m_s=10.0, height_m=60.0)
            await show.wait(1.0)
            near = [a for a in show.view.alarms if a.cause is AlarmCause.TRAFFIC_MANNED and a.lasts]
            texts += [alarm.text for alarm in near]
        past = alarms(show, lasting=True)
        for second in range(12):
            report(show, 170.0 - 10.0 * second, kind="manned", speed_m_s=-10.0, height_m=60.0)
            await show.wait(1.0)
        return texts, past, alarms(show, lasting=True)

    texts, past, back = fly(story, FOUR, after=running)
    assert "away; passes" in texts[0]
    assert "has passed" in texts[-1]
    assert len(texts) > 18
    assert AlarmCause.TRAFFIC_MANNED not in past
    assert AlarmCause.TRAFFIC_MANNED in back


@pytest.mark.soak
def test_paused_show_stays_paused_near_a_manned_aircraft() -> None:
    async def story(show: VirtualShow) -> None:
        await show.reach(ShowPhase.PAUSED)
        for _ in range(5):
            report(show, 150.0, kind="manned", height_m=60.0)
            await show.wait(1.0)
        reported = failsafe(show, Cause.MANNED_AIRCRAFT)
        assert reported is not None
        assert reported.action == "pause"
        assert show.view.show is ShowPhase.PAUSED

    fly(story, FOUR, after=paused)


@pytest.mark.soak
def test_manned_aircraft_brings_a_written_show_home(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        show_hash = written_show.select(show)
        await show.standby()
        show.service.commands.command_show(ShowAction.START, show_hash=show_hash)
        await show.reach(ShowPhase.RUNNING)
        report(show, 150.0, kind="manned", height_m=60.0)
        reported = await reacts(show, Cause.MANNED_AIRCRAFT)
        assert reported.action == "return"
        assert show.view.show is ShowPhase.RETURNING

    written_show.fly(story, written_show.config(tmp_path, **TRAFFIC))


@pytest.mark.soak
def test_vehicles_of_a_written_show_evade_a_drone(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        show_hash = written_show.select(show)
        await show.standby()
        show.service.commands.command_show(ShowAction.START, show_hash=show_hash)
        await show.reach(ShowPhase.RUNNING)
        closest_m = np.inf
        for second in range(24):
            x_m = -180.0 + 12.0 * second
            report(show, x_m, speed_m_s=12.0, height_m=16.0)
            for tenth in range(10):
                await show.wait(0.1)
                away_m = np.hypot(show.true_m[:, 0] - x_m - 1.2 * tenth, show.true_m[:, 1])
                closest_m = min(closest_m, float(away_m.min()))
        assert closest_m > RADIUS_M
        assert show.floor_violations() == 0

    written_show.fly(story, written_show.config(tmp_path, **TRAFFIC))


@pytest.mark.soak
@pytest.mark.parametrize("action", [ShowAction.ABORT, ShowAction.STOP])
def test_slow_track_does_not_stop_a_landing(action: ShowAction) -> None:
    """It is at the pads: vehicles land beside them."""

    async def story(show: VirtualShow) -> None:
        for second in range(150):
            report(show, 0.0, kind="ground", height_m=0.0)
            await show.wait(1.0)
            if second == 20:
                show.service.commands.command_show(action)
            if show.view.show is ShowPhase.LANDED:
                return
        assert show.view.show is ShowPhase.LANDED

    fly(story, FOUR, after=running)


@pytest.mark.soak
@pytest.mark.parametrize(("over_m", "manned"), [(500.0, 1), (11_000.0, 0)])
def test_pressure_tells_only_what_is_far_above(over_m: float, manned: int) -> None:
    async def story(show: VirtualShow) -> None:
        report(show, 100.0, kind="manned", pressure_altitude_m=show.config.frame.altitude_amsl_m + over_m)
        await show.wait(0.2)
        features = show.view.features.traffic
        assert features is not None
        assert features.manned == manned

    fly(story, FOUR)


@pytest.mark.soak
def test_only_vehicles_that_fly_count_as_the_formation() -> None:
    async def story(show: VirtualShow) -> None:
        traffic, (row, *_) = traffic_of(show), range(4)
        away_m = show.service.flight.newest.state.position_m.copy()
        away_m[row] = 3000.0, 0.0, 0.0
        show.service.flight.newest.state = replace(show.service.flight.newest.state, position_m=away_m)
        assert traffic._sphere().radius_m < 50.0

    fly(story, FOUR)


@pytest.mark.soak
def test_vehicle_under_a_pilot_is_none_of_the_formation() -> None:
    async def story(show: VirtualShow) -> None:
        near_m = traffic_of(show)._sphere().radius_m
        show.befall(show.config.ids[0], "pilot")
        await show.phase(show.config.ids[0], Phase.PILOT)
        away_m = show.service.flight.newest.state.position_m.copy()
        away_m[0] = 3000.0, 0.0, 0.0
        show.service.flight.newest.state = replace(show.service.flight.newest.state, position_m=away_m)
        assert traffic_of(show)._sphere().radius_m < 2.0 * near_m

    fly(story, FOUR, after=running)


@pytest.mark.soak
def test_alarms_do_not_flicker_in_a_flood() -> None:
    """The nearest tracks are others each second; each alarm stays for 10 s at least."""

    async def story(show: VirtualShow) -> set[str]:
        named = set()
        for second in range(9):
            for number in range(20):
                x_m = 60.0 + (number + 7 * second) % 20
                report(show, x_m, speed_m_s=-15.0, name=f"T{second}-{number}")
            await show.wait(1.0)
            found = [a for a in show.service.alarms.alarms if a.cause is AlarmCause.TRAFFIC_NEAR]
            named |= {alarm.text.split()[1] for alarm in found}
        return named

    assert len(fly(story, FOUR, after=running)) == ALARMS_MAX


@pytest.mark.soak
def test_alarms_of_many_tracks_are_few() -> None:
    async def story(show: VirtualShow) -> None:
        for number in range(20):
            report(show, 60.0 + number, speed_m_s=-15.0, name=f"T{number}")
        await show.wait(0.5)
        found = [alarm for alarm in show.service.alarms.alarms if alarm.cause is AlarmCause.TRAFFIC_NEAR]
        assert len(found) == ALARMS_MAX
        (crowded,) = [a for a in show.service.alarms.alarms if a.cause is AlarmCause.TRAFFIC_CROWDED]
        assert "12 more come near" in crowded.text

    fly(story, FOUR, after=running)


def test_no_report_ends_control() -> None:
    """Whatever numbers a source gives."""

    async def story(show: VirtualShow) -> None:
        random, frame = Random(1), show.config.frame
        odd = (nan, inf, -inf, 1e308, -1e308, 1e-170, 0.0, -1.0, 1.0)
        for number in range(2000):
            near = frame.latitude_deg + 1e-4 * random.random(), frame.longitude_deg
            where = near if random.random() < 0.8 else (random.choice(odd), random.choice(odd))
            values = [random.choice((*odd, frame.altitude_amsl_m)) for _ in range(8)]
            track, kind = f"T{number % 50}", random.choice(TRACK_KINDS)
            fields: dict[str, Any] = dict(zip(NUMBERS, values, strict=True))
            traffic_of(show).take(0, TargetFix(show.now_s, *where, track=track, kind=kind, **fields))
            if number % 100 == 0:
                await show.wait(0.1)
        await show.wait(1.0)
        assert show.view.show is ShowPhase.RUNNING

    fly(story, FOUR, after=running)


@pytest.mark.soak
def test_velocity_counts_without_a_climb() -> None:
    async def story(show: VirtualShow) -> None:
        report(show, 300.0, speed_m_s=-12.0, down_m_s=nan)
        await show.wait(0.2)
        features = show.view.features.traffic
        assert features is not None
        assert features.nearest[0].velocity_x_m_s == pytest.approx(-12.0, abs=0.1)

    fly(story, FOUR)


@pytest.mark.soak
def test_own_vehicle_is_no_traffic() -> None:
    async def story(show: VirtualShow) -> None:
        report(show, 100.0, kind="manned", name="0000aa")
        await show.wait(1.0)
        features = show.view.features.traffic
        assert features is not None
        assert (features.known, features.manned) == (0, 0)

    fly(story, FOUR, after=running)


def test_start_waits_until_traffic_is_gone() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        report(show, 100.0, kind="manned")
        await show.wait(0.5)
        check = {each.name: each for each in show.service.preflight.report().fleet}["traffic-clear"]
        assert not check.passes
        assert check.problem.startswith("traffic comes near: manned aircraft 4CA1B2, ")
        assert check.to_do == "wait until it has passed"
        (alarm,) = [each for each in show.view.alarms if each.cause is AlarmCause.TRAFFIC_MANNED]
        assert (alarm.severity, alarm.action) == (AlarmSeverity.INFORMATION, None)
        assert alarm.advice == "Start when it has passed."
        await show.wait(16.0)
        traffic_of(show).failed(0, "nothing arrives at udp://127.0.0.1:14999")
        checks = {each.name: each for each in show.service.preflight.report().fleet}
        assert checks["traffic-clear"].passes
        assert checks["traffic-known"].problem.startswith("traffic is not known: nothing arrives at")
        assert checks["traffic-known"].to_do == "check its source"

    fly(story, FOUR)


@pytest.mark.soak
def test_what_is_not_received_is_not_known() -> None:
    async def story(show: VirtualShow) -> None:
        traffic_of(show).failed(0, "nothing arrives at udp://127.0.0.1:14999")
        await show.wait(1.0)
        assert AlarmCause.TRAFFIC_UNKNOWN in alarms(show)
        features = show.view.features.traffic
        assert features is not None
        assert features.problem

    fly(story, FOUR, after=running)
