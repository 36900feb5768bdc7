"""The settings of a tick by the delay of the links."""

import numpy as np
import pytest

from gcs.control import ControlSettings
from gcs.control.late_links import LateAmongFast, fleet_delay_s, for_late_links
from gcs.model.response import FleetResponse

ALL = np.ones(4, np.bool_)


@pytest.mark.parametrize(
    ("delay_s", "counted_s"),
    [(0.0, 0.0), (0.05, 0.0), (0.07, 0.1), (0.1, 0.1), (0.12, 0.2), (0.4, 0.4), (3.0, 0.6)],
)
def test_delay_of_the_fleet_is_rounded_up_in_steps(delay_s: float, counted_s: float) -> None:
    assert fleet_delay_s(np.full(4, delay_s), ALL) == pytest.approx(counted_s)
    assert fleet_delay_s(np.full(4, delay_s), ~ALL) == 0.0, "none flies"


def test_step_is_left_by_more_than_a_little() -> None:
    counted_s, changes = 0.0, 0
    for delay_s in (0.07, 0.059, 0.061, 0.101, 0.11, 0.099, 0.13, 0.119, 0.1, 0.09, 0.05, 0.03):
        now_s = fleet_delay_s(np.full(4, delay_s), ALL, counted_s)
        changes += now_s != counted_s
        counted_s = now_s
    assert counted_s == 0.0
    assert changes == 3, "up twice, down at once"


def test_told_and_measured_delays_have_the_same_effect() -> None:
    plain = ControlSettings()
    given = plain.model_copy(update={"safety": plain.safety.model_copy(update={"link_delay_s": 0.3})})
    assert for_late_links(given, 0.0) == for_late_links(plain, 0.3) == for_late_links(given, 0.2)
    assert for_late_links(plain, 0.0) is plain


def test_rates_become_slower_with_the_delay() -> None:
    plain = ControlSettings()
    rates = [for_late_links(plain, delay_s).law.slot_rate_per_s for delay_s in (0.1, 0.2, 0.3, 0.6)]
    assert rates == pytest.approx([1.0, 1.0, 2 / 3, 1 / 3])
    assert for_late_links(plain, 0.1).loop_gain > 0.0
    assert for_late_links(plain, 0.2).loop_gain == 0.0


def test_vehicle_of_one_late_link_flies_with_gains_for_it() -> None:
    plain, usual = ControlSettings(), FleetResponse.alike(4)
    late = LateAmongFast(4).response(usual, np.array([0.03, 0.38, 0.03, 0.07]), ALL, plain)
    assert late.loop_share.tolist() == [1.0, 0.0, 1.0, 1.0]
    assert late.trim_share.tolist() == pytest.approx([1.0, 0.2, 1.0, 1.0])
    reaction_s = plain.safety.braking.reaction_s
    assert late.swings_s.tolist() == pytest.approx([0.0, reaction_s + 0.8, 0.0, reaction_s + 0.2])


def test_links_no_later_than_the_fleet_change_no_response() -> None:
    plain, usual, delay_s = ControlSettings(), FleetResponse.alike(4), np.full(4, 0.31)
    assert LateAmongFast(4).response(usual, delay_s, ALL, for_late_links(plain, 0.4)) is usual
    assert LateAmongFast(4).response(usual, delay_s, ~ALL, plain) is usual, "none flies"
    assert LateAmongFast(4).response(usual, np.full(4, 0.05), ALL, plain) is usual


def test_response_of_a_late_link_is_kept_until_its_step_changes() -> None:
    plain, usual, late = ControlSettings(), FleetResponse.alike(4), LateAmongFast(4)
    made = [
        late.response(usual, np.array([0.03, delay_s, 0.03, 0.03]), ALL, plain)
        for delay_s in (0.31, 0.399, 0.41, 0.299, 0.2, 0.2, 0.03)
    ]
    assert len({id(each) for each in made}) == 3
    assert made[0] is made[3], "one step"
    assert made[-1] is usual
