"""Shows with drawn parts in virtual time, as `gcs show check` flies them."""

from dataclasses import asdict
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
import yaml

from gcs.shows import load
from gcs.shows.formats import read_drawing, write_drawing
from gcs.shows.importing import show_text
from gcs.simulation.rehearsal import Rehearsal, judge
from gcs.simulation.scenario import World
from tests.support.drawn_shows import drawn_show

QUIET = World()
WITH_SPHERE = [
    {"cue": "drawn", "at_s": 0, "trajectories": {"from_s": 1.0, "to_s": 14.0}},
    {"cue": "sphere", "at_s": 15, "radius_m": 10.0, "height_m": 22.0, "target": {"x_m": 2.0, "y_m": 1.0}},
    {"cue": "drawn again", "at_s": 40, "trajectories": {"from_s": 14.0, "to_s": 29.0}},
]


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Rehearsal:
    """A drawn part, the self-organising sphere, and a drawn part again."""
    folder: Path = tmp_path_factory.mktemp("shows")
    write_drawing(drawn_show(8, 30.0, 6.0, ("rings",)), folder / "rings.skyc")
    drawing, data = read_drawing(folder / "rings.skyc")
    raw = yaml.safe_load(show_text(drawing, "rings.skyc", sha256(data).hexdigest()))
    raw["fence"] = {"height_min_m": 3, "height_max_m": 60, "distance_max_m": 80}
    raw |= {"timeline": WITH_SPHERE, "duration_s": 56.0}
    (folder / "mixed.yaml").write_text(yaml.safe_dump(raw, sort_keys=False))
    flight = Rehearsal(load(folder / "mixed.yaml"), QUIET, 1)
    flight.fly()
    return flight


def test_drawing_and_sphere_take_turns(mixed: Rehearsal) -> None:
    verdict = judge(mixed)
    assert verdict.good, verdict.problems
    assert verdict.pairs_below_floor == 0
    assert verdict.track_rms_m is not None
    assert verdict.track_rms_m <= 0.3
    drawn, sphere, again = verdict.cues
    assert (drawn.radius_error_m, again.radius_error_m) == (None, None)
    assert sphere.radius_error_m is not None
    assert sphere.radius_m == 10.0


def test_the_clock_waits_until_a_part_can_begin(mixed: Rehearsal) -> None:
    show_s = np.array(mixed.show_s)
    waited_s = float(np.count_nonzero(np.abs(show_s - 40.0) < 0.06)) * mixed.world.tick_s
    assert 3.0 < waited_s < 60.0
    errors_m = np.stack(mixed.off_m)[np.flatnonzero(show_s[: len(mixed.off_m)] > 40.2)]
    assert np.nanmax(errors_m[:20]) < 1.0


def test_lags_name_every_vehicle_the_farthest_first(mixed: Rehearsal) -> None:
    lags = judge(mixed).lags
    assert sorted(lag.vehicle for lag in lags) == list(range(1, 9))
    sizes = [lag.max_m for lag in lags]
    assert sizes == sorted(sizes, reverse=True)
    assert {asdict(lag)["trajectory"] for lag in lags} == {f"drone {number}" for number in range(1, 9)}
