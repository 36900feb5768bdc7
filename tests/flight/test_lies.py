"""Vehicles that report what is not so, in simulated flights at the least radius: `gcs simulate lies`."""

import pytest

from gcs.model.errors import ConfigError
from gcs.simulation.batch import Run, run_once
from gcs.simulation.scenario import Scenario

LIES = Scenario.load("lies")
SEEDS = range(12900, 12900 + 3 * len(LIES.worlds))
FEW = 1

SHORT_S = 22.0
"""Ten seconds after the lies begin."""


@pytest.mark.parametrize("count", [8, pytest.param(20, marks=pytest.mark.soak)])
@pytest.mark.parametrize(
    "seed", [pytest.param(seed, marks=pytest.mark.soak if at >= FEW else ()) for at, seed in enumerate(SEEDS)]
)
def test_liars_are_named_and_the_others_keep_apart(seed: int, count: int) -> None:
    figures = run_once(Run(LIES.with_(duration_s=SHORT_S), count, seed))
    assert figures["failed"] == []


def test_lies_need_the_failsafes_that_name_them() -> None:
    with pytest.raises(ConfigError, match="failsafes: needed with"):
        LIES.with_(failsafes=None)


@pytest.mark.parametrize(
    ("lies", "words"),
    [
        ({"kinds": []}, "kinds: at least one"),
        ({"kinds": ["boasts"]}, "kinds"),
        ({"share_min": 0.3, "share_max": 0.2}, "share_min 0.3 <= share_max 0.2 <= 1"),
        ({"from_s": -1.0}, "from_s"),
    ],
)
def test_impossible_lies_are_refused(lies: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        LIES.with_(worlds=(), lies=lies)
