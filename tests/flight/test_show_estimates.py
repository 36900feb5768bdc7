"""Energy and time that the service foretells, against what then happened."""

from typing import Any, NamedTuple

import numpy as np
import pytest

from gcs.estimation.time_estimates import Estimates
from gcs.model.lifecycle import ShowPhase
from gcs.model.plan import Orbit
from gcs.service import ShowAction
from gcs.sim.vehicle.px4 import Quirks
from gcs.testing.virtual_show import SLOWLY_DISARMED, FlownSample, FlownTrack, VirtualShow, fly, show_config

ENDURANCE_S = 600.0
BELOW = 0.2
"""Threshold of the low-battery failsafe, as by default."""

SPARE_S, SPARE_SHARE = 4.0, 0.15
"""What an estimate may be off by: the greater of both."""


class Flight(NamedTuple):
    track: FlownTrack
    assembled_s: float
    stop_s: float
    landed_s: float


async def out_and_home(show: VirtualShow) -> Flight:
    await show.standby()
    show.service.commands.command_show(ShowAction.START)
    await show.reach(ShowPhase.RUNNING, 200.0)
    assembled_s = show.now_s
    show.service.plan.set_orbit(Orbit(radius_m=6.0, speed_m_s=2.0))
    await show.wait(60.0)
    stop_s = show.now_s
    show.service.commands.command_show(ShowAction.STOP)
    await show.reach(ShowPhase.LANDED, 200.0)
    landed_s = show.now_s
    await show.wait(3.0)
    return Flight(show.track, assembled_s, stop_s, landed_s)


@pytest.fixture(scope="module", params=[4, pytest.param(12, marks=pytest.mark.soak)])
def flight(request: pytest.FixtureRequest) -> Flight:
    count: int = request.param
    formation = {"radius_m": 6.0, "height_m": 14.0} if count == 4 else {"radius_m": 10.0, "height_m": 20.0}
    as_px4: dict[str, Any] = {"quirks": Quirks(), "parameters": SLOWLY_DISARMED}
    return fly(out_and_home, show_config(count, formation=formation), endurance_s=ENDURANCE_S, **as_px4)


def estimates_of(sample: FlownSample) -> Estimates:
    assert sample.view.estimates is not None
    return sample.view.estimates


def allowed(true_s: float) -> float:
    return max(SPARE_S, SPARE_SHARE * true_s)


@pytest.mark.soak
def test_assembly_time_is_estimated_correctly(flight: Flight) -> None:
    forming = [
        (sample.time_s, estimates_of(sample).assembled_s)
        for sample in flight.track.between(0.0, flight.assembled_s - 0.2).samples
        if sample.view.show in {ShowPhase.ARMING, ShowPhase.ASSEMBLING}
    ]
    known = [(flight.assembled_s - time_s, found_s) for time_s, found_s in forming if found_s is not None]
    assert len(known) > 0.8 * len(forming)  # a second passes until the first
    assert max(abs(found_s - true_s) - allowed(true_s) for true_s, found_s in known) < 1.0  # once a second


@pytest.mark.soak
def test_time_home_is_estimated_before_and_during_the_return(flight: Flight) -> None:
    at_stop = estimates_of(flight.track.between(0.0, flight.stop_s).samples[-1]).home_s
    took_s = flight.landed_s - flight.stop_s
    assert at_stop is not None
    assert abs(at_stop - took_s) < allowed(took_s)
    left = [
        (flight.landed_s - sample.time_s, estimates_of(sample).home_s)
        for sample in flight.track.between(flight.stop_s + 4.0, flight.landed_s - 0.2).samples
    ]
    assert all(found_s is not None for _, found_s in left)
    off_s = [abs((found_s or 0.0) - true_s) - allowed(true_s) for true_s, found_s in left]
    assert max(off_s) < 1.0  # once a second


@pytest.mark.soak
def test_unknown_or_past_estimate_is_absent(flight: Flight) -> None:
    for sample in flight.track.samples:
        estimates, show = estimates_of(sample), sample.view.show
        if show in {ShowPhase.RUNNING, ShowPhase.RETURNING, ShowPhase.LANDED} and sample.time_s % 1.0 > 0.5:
            assert estimates.assembled_s is None or sample.time_s < flight.assembled_s + 1.1
        if sample.time_s < 5.0 or sample.time_s > flight.landed_s + 1.1:
            assert estimates.home_s is None
            assert np.isnan(estimates.low_s).all()
    early = estimates_of(flight.track.between(0.0, flight.assembled_s - 10.0).samples[-1])
    assert np.isnan(early.empty_s).all()  # less than three percent were used


@pytest.mark.soak
def test_battery_time_is_estimated_correctly(flight: Flight) -> None:
    sample = flight.track.between(0.0, flight.stop_s).samples[-1]
    estimates, remaining = estimates_of(sample), sample.view.rows.battery_remaining
    step = 0.01  # batteries report whole per cents, and estimates are made once a second
    assert estimates.battery_least == pytest.approx(remaining.min(), abs=step)
    assert estimates.battery_median == pytest.approx(np.median(remaining), abs=step)
    assert estimates.battery_least_row is not None
    assert remaining[estimates.battery_least_row] <= remaining.min() + step
    np.testing.assert_allclose(estimates.low_s, ENDURANCE_S * (remaining - BELOW), atol=15.0)
    np.testing.assert_allclose(estimates.empty_s, ENDURANCE_S * remaining, atol=15.0)
    assert estimates.low_row == int(np.argmin(estimates.low_s))
