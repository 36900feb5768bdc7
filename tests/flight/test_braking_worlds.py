"""No vehicle of either autopilot passes the fence, a wall or the floor, wherever it is sent."""

import pytest

from tests.support.braking_worlds import flown

pytestmark = pytest.mark.soak

USUAL, WORLDS = 4, 200


@pytest.mark.parametrize(
    "seeds",
    [range(USUAL), pytest.param(range(USUAL, WORLDS), marks=pytest.mark.soak)],
    ids=["some", "all"],
)
def test_nothing_is_passed_in_random_worlds(seeds: range) -> None:
    passed = {seed: found for seed in seeds if (found := flown(seed)).worst_m > 0.0}
    assert passed == {}
