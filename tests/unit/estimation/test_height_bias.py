"""Heights that depart from those of the receivers: which vehicle is named, by how much, and which are not."""

import numpy as np
import pytest

from gcs.estimation.height_bias import WINDOW, HeightBias, HeightComparison, HeightSettings
from gcs.links.telemetry import FleetTelemetry
from gcs.model.state import Array, Landed, Telemetry
from tests.support.reported import reported
from tests.support.tlog_files import frames, read

SETTINGS = HeightSettings()
PAD_M = 488.0


def telemetry(
    altitude_m: Array, gnss_m: Array, *, armed: bool, accuracy_m: float, down_m_s: float = 0.0
) -> Telemetry:
    n = len(altitude_m)
    return reported(
        [f"d{row + 1}" for row in range(n)],
        altitude_amsl_m=altitude_m,
        velocity_ned_m_s=np.tile([0.0, 0.0, down_m_s], (n, 1)),
        armed=(armed,) * n,
        landed=(Landed.UNKNOWN,) * n,
        vertical_accuracy_m=accuracy_m,
        gnss_altitude_amsl_m=gnss_m,
    )


class Flight:
    """Vehicles stand for a minute, climb at 2 m/s, and hover; heights are true ones, second by second."""

    def __init__(
        self, scale: list[float], *, noise_m: float = 0.1, accuracy_m: float = 0.2, seed: int = 1
    ) -> None:
        self.comparison = HeightComparison(len(scale), SETTINGS)
        self.scale, self.noise_m, self.accuracy_m = np.array(scale), noise_m, accuracy_m
        self.random = np.random.default_rng(seed)
        self.offset_m = self.random.normal(0.0, 2.0, len(scale))  # of the first fix
        self.drift_m = np.zeros(len(scale))  # of the barometers
        self.common_m = 0.0  # of all receivers
        self._wander_m = self.random.normal(0.0, noise_m, len(scale))
        self.time_s = 0.0

    def second(self, height_m: float, *, armed: bool) -> HeightBias:
        n, keep = len(self.scale), np.exp(-1.0 / 4.0)  # forgotten within 4 s
        fresh_m = self.random.normal(0.0, self.noise_m, n)
        self._wander_m = keep * self._wander_m + np.sqrt(1.0 - keep**2) * fresh_m
        true_m = PAD_M + height_m * np.ones(n)
        reported_m = PAD_M + height_m * (1.0 + self.scale) + self.drift_m + self.offset_m
        received_m = true_m + self._wander_m + self.common_m
        reported = telemetry(reported_m, received_m, armed=armed, accuracy_m=self.accuracy_m)
        self.comparison.note(reported, np.ones(n, np.bool_), self.time_s)
        self.time_s += 1.0
        return self.comparison.found

    def stand(self, seconds: int) -> HeightBias:
        return [self.second(0.0, armed=False) for _ in range(seconds)][-1]

    def climb(self, to_m: float) -> HeightBias:
        return [self.second(height_m, armed=True) for height_m in np.arange(0.0, to_m, 2.0)][-1]

    def hover(self, height_m: float, seconds: int) -> list[HeightBias]:
        return [self.second(height_m, armed=True) for _ in range(seconds)]


COPTER = 0.049
"""Reports 25.1 m at 23.9 m."""

MIXED = [0.0, COPTER] * 3


@pytest.mark.parametrize("seed", range(5))
def test_scale_of_a_barometer_is_named_within_30_s(seed: int) -> None:
    flight = Flight(MIXED, seed=seed)
    flight.stand(60)
    flight.climb(25.0)
    found = flight.hover(25.0, 30)[-1]
    assert found.named.tolist() == [False, True] * 3
    assert found.bias_m[1::2] == pytest.approx(25.0 * COPTER, abs=0.25)
    assert found.scale[1::2] == pytest.approx(COPTER, abs=0.01)
    assert found.in_words(1).startswith("1.")
    assert "below what it reports" in found.in_words(1)


def test_one_of_many_is_named_and_no_other() -> None:
    flight = Flight([0.0] * 7 + [-0.06])
    flight.stand(60)
    flight.climb(30.0)
    found = flight.hover(30.0, 30)[-1]
    assert found.named.tolist() == [False] * 7 + [True]
    assert "above what it reports" in found.in_words(7)


@pytest.mark.parametrize("seed", range(10))
def test_healthy_fleet_is_never_named(seed: int) -> None:
    """PX4's recorded noise; 10 vehicles stand for 20 s only, and fly for five minutes at changing heights."""
    flight = Flight([0.0] * 10, noise_m=0.55, accuracy_m=1.78, seed=seed)
    flight.stand(20)
    flight.climb(20.0)
    for second in range(300):
        flight.common_m = 2.0 * np.sin(second / 60.0)  # satellites: of all receivers
        assert not flight.second(20.0 + 10.0 * np.sin(second / 20.0), armed=True).named.any()


def test_scale_that_all_have_endangers_no_pair() -> None:
    flight = Flight([COPTER] * 4)
    flight.stand(60)
    flight.climb(25.0)
    assert not any(found.named.any() for found in flight.hover(25.0, 60))


@pytest.mark.parametrize(("count", "seed"), [(2, 280), (3, 80), (4, 155)])
def test_few_that_are_compared_have_no_certain_scale(count: int, seed: int) -> None:
    flight = Flight([COPTER] * count, noise_m=0.2, seed=seed)
    flight.stand(4)
    flight.climb(12.0)
    assert not any(found.named.any() for found in flight.hover(12.0, 15))


def test_drift_on_the_ground_is_named_before_the_take_off() -> None:
    flight = Flight([0.0] * 4)
    flight.stand(WINDOW)
    assert not flight.stand(60).named.any()
    flight.drift_m[2] = 1.5
    found = flight.stand(300)
    assert found.named.tolist() == [False, False, True, False]
    assert np.isnan(found.scale[2])
    assert found.in_words(2) == "1.5 m below what it reports, by its receiver and the others"


def test_drift_in_the_air_is_named_as_well() -> None:
    flight = Flight([0.0] * 4)
    flight.stand(60)
    flight.climb(10.0)
    flight.hover(10.0, 30)
    flight.drift_m[0] = -2.0
    assert flight.hover(10.0, 180)[-1].named.tolist() == [True, False, False, False]


def test_nothing_is_claimed_without_others_receiver_or_reference() -> None:
    alone = Flight([COPTER])
    alone.stand(60)
    alone.climb(25.0)
    assert np.isnan(alone.hover(25.0, 30)[-1].bias_m).all()
    blind = Flight(MIXED, accuracy_m=np.inf)
    blind.stand(60)
    blind.climb(25.0)
    assert not blind.hover(25.0, 30)[-1].named.any()
    flying = Flight(MIXED)  # the service was restarted in flight
    assert np.isnan(flying.hover(25.0, 60)[-1].bias_m).all()


def test_poor_receivers_need_longer() -> None:
    """Beyond four standard errors only: with PX4's noise after more than half a minute."""
    flight = Flight(MIXED, noise_m=0.55, accuracy_m=1.78)
    flight.stand(60)
    flight.climb(25.0)
    assert not flight.hover(25.0, 10)[-1].named.any()
    assert (flight.comparison.found.error_m[1::2] > 0.25 * COPTER * 25.0).all()


def test_reserve_up_and_down_grows_by_the_difference() -> None:
    """Of a pair of equal receivers, by what both are off."""
    off_m = np.array([1.2, 0.0, 0.6])
    found = HeightBias(off_m, np.full(3, 0.1), off_m / 25.0, np.array([True, False, True]))
    wide_m = found.widening_m(6.0, 2.0)
    for u_m in (0.05, 0.2, 1.0):
        before_m = 6.0 * 2.0 * np.hypot(u_m, u_m)
        after_m = 6.0 * 2.0 * np.hypot(u_m + wide_m[0], u_m + wide_m[2])
        assert after_m >= before_m + 1.8 - 1e-9
        after_m = 6.0 * 2.0 * np.hypot(u_m + wide_m[0], u_m + wide_m[1])
        assert after_m >= before_m + 1.2 - 1e-9
    assert wide_m[1] == 0.0


def test_recorded_ardupilot_is_named_beside_healthy_ones() -> None:
    """From 9 m on its receiver has 3 to 5 % less height than it reports; of two others it has the same."""
    link, comparison = FleetTelemetry(("d1",)), HeightComparison(3, SETTINGS)
    named_at_m, highest_m, next_s = list[float](), 0.0, 0.0
    for time_s, frame in frames("ardupilot/session.tlog.xz"):
        read(link, time_s, frame)
        reported = link.telemetry()
        if time_s < next_s or np.isnan(reported.gnss_altitude_amsl_m[0]):
            continue
        next_s = time_s + 1.0
        reported_m, received_m = reported.altitude_amsl_m[0], reported.gnss_altitude_amsl_m[0]
        beside = telemetry(
            np.array([reported_m, received_m, received_m]),
            np.full(3, received_m),
            armed=reported.armed[0],
            accuracy_m=float(reported.vertical_accuracy_m[0]),
            down_m_s=float(reported.velocity_ned_m_s[0, 2]),
        )
        comparison.note(beside, np.ones(3, np.bool_), time_s)
        found, height_m = comparison.found, float(reported_m) - PAD_M
        highest_m = max(highest_m, height_m)
        assert not found.named[1:].any()
        if found.named[0]:
            named_at_m.append(height_m)
            assert 0.03 < found.scale[0] < 0.06
    assert highest_m > 12.0
    assert named_at_m


@pytest.mark.parametrize("drift_m", [3.0, -3.0])
def test_drift_of_the_last_minute_counts_for_the_landing(drift_m: float) -> None:
    """Long before its mean shows it, and also where all drift alike."""
    flight = Flight([0.0] * 4)
    flight.stand(30)
    flight.climb(20.0)
    flight.hover(20.0, 30)
    for share in np.linspace(0.0, 1.0, 12):
        flight.drift_m[:] = share * drift_m
        flight.second(20.0, armed=True)
    flight.hover(20.0, 4)
    assert flight.comparison.departed_m == pytest.approx([drift_m] * 4, abs=0.7)


def test_departure_is_unknown_without_a_reference() -> None:
    flight = Flight([0.0] * 2)
    flight.hover(20.0, 10)
    assert np.isnan(flight.comparison.departed_m).all()
