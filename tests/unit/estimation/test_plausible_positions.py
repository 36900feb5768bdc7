"""Positions are accepted only where a vehicle can be."""

import numpy as np
import pytest

from gcs.estimation.fleet_state import CONSISTENT_S, FAR_M, FORWARD_MAX_S, Table, into_frame
from gcs.model.frames import ShowFrame, wrap_rad
from gcs.model.state import FleetState, Landed
from tests.support.reported import reported

FRAME = ShowFrame(47.0, 8.0, 400.0)
STEP_S = 0.1
HERE, THERE = (10.0, 5.0, -20.0), (5010.0, 5.0, -20.0)


class ReportedVehicle:
    """One vehicle, told every tenth of a second to be where it is not, or is."""

    def __init__(self) -> None:
        self.table = Table(("a",), FRAME)
        self.time_s = 100.0
        self.resets = 0  # as its estimator counts them

    def tell(
        self,
        place: tuple[float, float, float],
        *,
        armed: bool = True,
        velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
        nowhere: bool = False,
        fix: float = 3.0,
        clock_s: float = np.nan,
    ) -> FleetState:
        """One message, and the tick that follows at once."""
        self.time_s += STEP_S
        latitude, longitude, altitude = FRAME.geodetic(np.array([place]))
        if nowhere:
            latitude, longitude = np.zeros(1), np.zeros(1)
        return self.table.state(
            [
                reported(
                    ("a",),
                    self.time_s,
                    latitude_deg=latitude,
                    longitude_deg=longitude,
                    altitude_amsl_m=altitude,
                    velocity_ned_m_s=np.array([velocity]),
                    armed=(armed,),
                    landed=(Landed.IN_AIR if armed else Landed.ON_GROUND,),
                    position_resets=(self.resets,),
                    fix_type=fix,
                    position_clock_s=clock_s,
                )
            ],
            self.time_s,
        )

    def keep_telling(
        self, place: tuple[float, float, float], seconds: float, *, armed: bool = True
    ) -> list[FleetState]:
        """The same place for a while."""
        return [self.tell(place, armed=armed) for _ in range(round(seconds / STEP_S))]


def ages_s(states: list[FleetState]) -> set[float]:
    return {float(state.age_s[0]) for state in states}


@pytest.mark.parametrize(
    "frame", [FRAME, ShowFrame(-33.9, 151.2, 5.0, 37.0), ShowFrame(89.9, -179.99, -20.0, 200.0)]
)
def test_compiled_conversion_equals_pymap3d(frame: ShowFrame) -> None:
    random, n = np.random.default_rng(3), 50
    latitude_deg = frame.latitude_deg + random.normal(0.0, 0.03, n)
    longitude_deg = frame.longitude_deg + random.normal(0.0, 0.03, n)
    altitude_m = frame.altitude_amsl_m + random.normal(0.0, 99.0, n)
    ned_m_s, yaw_deg = random.normal(0.0, 5.0, (n, 3)), random.uniform(0.0, 360.0, n)
    position_m, velocity_m_s = np.zeros((n, 3)), np.zeros((n, 3))
    yaw_rad, exists = np.zeros(n), np.zeros(n, np.bool_)
    origin = (frame.latitude_deg, frame.longitude_deg, frame.altitude_amsl_m, frame.heading_deg)
    time_s, armed, resets = np.zeros(n), np.zeros(n, np.bool_), np.zeros(n, np.int64)
    arrived_s, is_armed, counted = random.normal(0.0, 1.0, n), np.arange(n) % 2 == 0, np.arange(n)
    into_frame(
        np.arange(n),
        (latitude_deg, longitude_deg, altitude_m, yaw_deg),
        ned_m_s,
        arrived_s,
        (is_armed, counted),
        origin,
        (position_m, velocity_m_s, yaw_rad, time_s, exists, armed, resets),
    )
    columns = (time_s, arrived_s), (armed, is_armed), (resets, counted)
    assert all((written == given).all() for written, given in columns)
    assert position_m == pytest.approx(frame.position_m(latitude_deg, longitude_deg, altitude_m), abs=1e-8)
    assert velocity_m_s == pytest.approx(frame.from_ned(ned_m_s))
    assert yaw_rad == pytest.approx(wrap_rad(np.radians(yaw_deg - frame.heading_deg)))
    assert exists.tolist() == (np.linalg.norm(position_m, axis=1) <= FAR_M).tolist()


@pytest.fixture
def received() -> ReportedVehicle:
    """A vehicle that has been where it is for a second."""
    vehicle = ReportedVehicle()
    vehicle.keep_telling(HERE, 1.0)
    return vehicle


def test_position_jump_is_rejected_and_the_last_one_is_shown(received: ReportedVehicle) -> None:
    for state in received.keep_telling(THERE, 4.0):
        assert state.position_m[0] == pytest.approx(HERE, abs=1e-3)
        assert state.age_s[0] == np.inf


def test_position_that_jumps_back_is_accepted_at_once(received: ReportedVehicle) -> None:
    received.keep_telling(THERE, 4.0)
    state = received.tell((16.0, 5.0, -20.0))
    assert state.position_m[0] == pytest.approx((16.0, 5.0, -20.0), abs=1e-3)
    assert state.age_s[0] == 0.0


def test_single_wrong_message_costs_only_itself(received: ReportedVehicle) -> None:
    assert received.tell((24.0, 5.0, -20.0)).age_s[0] == np.inf
    assert received.tell(HERE).age_s[0] == 0.0


def test_on_the_ground_a_persistent_new_position_is_accepted() -> None:
    vehicle = ReportedVehicle()
    vehicle.keep_telling(HERE, 1.0, armed=False)
    states = vehicle.keep_telling(THERE, CONSISTENT_S + 0.05, armed=False)
    assert ages_s(states) == {np.inf}
    settled = vehicle.keep_telling(THERE, 0.3, armed=False)[-1]
    assert settled.age_s[0] == 0.0
    assert settled.position_m[0] == pytest.approx(THERE, abs=1e-3)


def test_position_that_keeps_jumping_is_never_accepted() -> None:
    vehicle = ReportedVehicle()
    vehicle.keep_telling(HERE, 1.0, armed=False)
    states = [vehicle.tell((1000.0 * (index % 2) + 500.0, 0.0, 0.0), armed=False) for index in range(60)]
    assert ages_s(states) == {np.inf}


def test_in_the_air_a_reset_of_metres_is_accepted_when_flyable(
    received: ReportedVehicle,
) -> None:
    states = received.keep_telling((40.0, 5.0, -20.0), 4.0)
    believed = [state.age_s[0] == 0.0 for state in states]
    assert not any(believed[: round(CONSISTENT_S / STEP_S)])
    assert all(believed[round(CONSISTENT_S / STEP_S) + 1 :])


def test_in_the_air_kilometres_need_the_time_to_fly_them(received: ReportedVehicle) -> None:
    assert ages_s(received.keep_telling(THERE, 60.0)) == {np.inf}


@pytest.mark.parametrize("armed", [True, False])
def test_null_island_is_never_accepted(armed: bool) -> None:
    at_zero = ShowFrame(0.0, 0.0, 400.0)
    vehicle = ReportedVehicle()
    vehicle.table = Table(("a",), at_zero)  # even here
    states = [vehicle.tell(HERE, armed=armed, nowhere=True) for _ in range(50)]
    assert ages_s(states) == {np.inf}
    assert all(np.isnan(state.position_m).all() for state in states)


def test_implausible_first_position_is_rejected_until_a_good_one() -> None:
    vehicle = ReportedVehicle()
    assert ages_s(vehicle.keep_telling((FAR_M + 5.0, 0.0, 0.0), 5.0, armed=False)) == {np.inf}
    assert vehicle.tell(HERE, armed=False).age_s[0] == 0.0


def test_silent_vehicle_may_be_as_far_as_it_could_have_flown(received: ReportedVehicle) -> None:
    received.time_s += 30.0
    assert received.tell((700.0, 5.0, -20.0)).age_s[0] == 0.0
    received.time_s += 30.0
    assert received.tell((-300.0, 5.0, -20.0)).age_s[0] == np.inf


def test_fastest_plausible_flight_is_always_accepted(received: ReportedVehicle) -> None:
    states = [
        received.tell((10.0 + 2.5 * index, 5.0, -20.0), velocity=(25.0, 0.0, 0.0)) for index in range(50)
    ]
    assert ages_s(states) == {0.0}


def test_rejected_position_is_extrapolated_as_usual() -> None:
    vehicle = ReportedVehicle()
    for index in range(10):
        vehicle.tell((0.3 * index, 0.0, -20.0), velocity=(3.0, 0.0, 0.0))
    last = [vehicle.tell(THERE, velocity=(-9.0, 9.0, 9.0)) for _ in range(30)][-1]
    assert last.position_m[0] == pytest.approx((2.7 + 3.0 * FORWARD_MAX_S, 0.0, -20.0), abs=1e-3)
    assert last.velocity_m_s[0] == pytest.approx((1.5, 0.0, 0.0))  # 3 s after it was believed: it fades


def test_same_message_evaluated_twice_gives_the_same_result(received: ReportedVehicle) -> None:
    first = received.tell(THERE)
    received.time_s -= STEP_S
    again = received.tell(THERE)
    assert again.age_s.tolist() == first.age_s.tolist()
    assert again.position_m.tolist() == first.position_m.tolist()


def reset_times_s(
    received: ReportedVehicle, places: list[tuple[float, float, float]], counted: int
) -> set[float]:
    """Times since the first of these places at which a reset began; the counter goes up at one of them."""
    began_s, found = received.time_s + STEP_S, set()
    for index, place in enumerate(places):
        received.resets += index == counted
        received.tell(place)
        found.add(round(float(received.table.reset_time_s[0]) - began_s, 3))
    return found - {-np.inf}


MOVED = (HERE[0] + 0.5, HERE[1], HERE[2])
FAR = (HERE[0] + 3.0, HERE[1], HERE[2])


def test_counted_reset_that_moves_nothing_is_none(received: ReportedVehicle) -> None:
    """As after every take-off of a real PX4: of its heading."""
    assert reset_times_s(received, [HERE] * 20, counted=3) == set()


@pytest.mark.parametrize("counted", [1, 5, 9])
@pytest.mark.parametrize("place", [MOVED, FAR])
def test_jump_and_its_counter_are_one_reset(
    received: ReportedVehicle, place: tuple[float, float, float], counted: int
) -> None:
    found = reset_times_s(received, [HERE] * 5 + [place] * 15, counted)
    small_and_later = place is MOVED and counted > 5
    assert found == {STEP_S * (counted if small_and_later else 5)}


def test_small_step_without_a_counter_is_no_reset(received: ReportedVehicle) -> None:
    assert reset_times_s(received, [HERE] * 5 + [MOVED] * 15, counted=99) == set()


def test_positions_without_a_3d_fix_are_doubtful(received: ReportedVehicle) -> None:
    assert received.tell(HERE).doubtful.tolist() == [False]
    assert received.tell(HERE, fix=2.0).doubtful.tolist() == [True]
    assert received.tell(HERE, fix=np.nan).doubtful.tolist() == [False], "indoors none may be reported"


@pytest.mark.parametrize(("aside_m", "jumps"), [(0.0, 0), (4.0, 1)])
def test_positions_that_waited_for_a_link_are_no_jump(aside_m: float, jumps: int) -> None:
    """A link stands for 0.8 s; then it delivers what waited over two ticks, the oldest first."""
    received, resets = ReportedVehicle(), set()
    for sent_s in (*np.arange(0.0, 2.0, STEP_S), 2.1, 2.8, *np.arange(2.9, 4.0, STEP_S)):
        east_m = 5.0 + (aside_m if sent_s >= 2.8 else 0.0)
        if sent_s == 2.1:
            received.time_s += 0.7
        received.tell((4.0 * sent_s, east_m, -20.0), velocity=(4.0, 0.0, 0.0), clock_s=float(sent_s))
        resets.add(float(received.table.reset_time_s[0]))
    assert len(resets - {-np.inf}) == jumps
