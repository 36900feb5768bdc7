"""A drawn show is moved and turned on its field, and its pads are fitted to where the vehicles stand."""

from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from gcs.config.yaml_files import Source
from gcs.model.errors import RefusedError
from gcs.model.frames import ShowFrame
from gcs.model.state import Array
from gcs.shows import LoadedShow, load, parse
from gcs.shows.drawn import DrawnShow
from gcs.shows.formats import read_drawing, write_drawing
from gcs.shows.importing import show_text
from gcs.shows.placement import (
    fence_m,
    fitted,
    in_frame,
    place_of,
    placed_pads_m,
    placed_text,
    placement,
    stand,
    standing_on,
)
from gcs.simulation.drawn_traffic import ORIGIN
from tests.support.drawn_shows import drawn_show

THERE = placement(12.0, -7.5, 35.0)


@pytest.fixture(scope="module")
def night(tmp_path_factory: pytest.TempPathFactory) -> LoadedShow:
    """Twelve vehicles, on pads of four columns."""
    folder = tmp_path_factory.mktemp("placed")
    write_drawing(drawn_show(12, 30.0, 3.0, ("rings",)), folder / "night.skyc")
    drawing, data = read_drawing(folder / "night.skyc")
    path = folder / "night.yaml"
    path.write_text(show_text(drawing, "night.skyc", sha256(data).hexdigest()))
    return load(path)


def placed(night: LoadedShow, text: str) -> LoadedShow:
    return parse(text, night.file)


def text_of(night: LoadedShow) -> str:
    return Path(night.file).read_text()


def at_there(night: LoadedShow, frame: ShowFrame = ORIGIN) -> LoadedShow:
    text, fence = text_of(night), fence_m(night.show, _drawing(night), THERE)
    return placed(night, placed_text(night.source, text, night.show, fence, THERE, frame))


def _drawing(night: LoadedShow) -> DrawnShow:
    assert night.drawing is not None
    return night.drawing


def test_drawing_and_pads_move_together(night: LoadedShow) -> None:
    moved = at_there(night)
    assert place_of(moved.show) == THERE
    for before_m, after_m in (
        (night.show.pads_m, moved.show.pads_m),
        (_drawing(night).trajectories.at(9.0).position_m, _drawing(moved).trajectories.at(9.0).position_m),
        (_drawing(night).home_m, _drawing(moved).home_m),
    ):
        assert after_m == pytest.approx(THERE.placed_m(before_m), abs=1e-9)
    # 35 degrees clockwise: what lay ahead lies ahead and to the right
    assert THERE.placed_m(np.array([[10.0, 0.0, 0.0]]))[0, 1] > THERE.y_m


def test_another_placement_is_another_show_to_check(night: LoadedShow) -> None:
    assert at_there(night).show.digest != night.show.digest


def test_the_room_to_the_fence_stays(night: LoadedShow) -> None:
    moved = at_there(night)
    assert moved.show.fence.distance_max_m > night.show.fence.distance_max_m + 5.0
    assert fence_m(moved.show, _drawing(moved), placement(0.0, 0.0, 0.0)) == pytest.approx(
        night.show.fence.distance_max_m, abs=0.11
    )
    turned = placement(0.0, 0.0, 90.0)
    assert fence_m(night.show, _drawing(night), turned) == pytest.approx(
        night.show.fence.distance_max_m, abs=0.11
    )


def test_comments_and_everything_else_stay(night: LoadedShow) -> None:
    text = text_of(night) + "# the operator's remark\n"
    source = Source(text, "night.yaml")
    once = placed_text(source, text, night.show, night.show.fence.distance_max_m, THERE, ORIGIN)
    assert once.count("place: {x_m: 12, y_m: -7.5, turn_deg: 35}") == 1
    assert once.endswith("# the operator's remark\n")
    again = placed_text(
        Source(once, "night.yaml"),
        once,
        night.show,
        night.show.fence.distance_max_m,
        placement(0, 0, 0),
        ORIGIN,
    )
    assert again.count("place:") == 1
    assert again.replace("place: {x_m: 0, y_m: 0, turn_deg: 0}, ", "") == text


BLOCKS = """\
drawing:
  source: a.skyc
  place:  # as surveyed
    x_m: 1
    y_m: 2  # of the stage
  late: wait
fence: {distance_max_m: 10}
"""


def test_values_change_in_a_file_of_any_style() -> None:
    source = Source(BLOCKS, "a.yaml")
    changed = source.changed(
        BLOCKS,
        {
            ("drawing", "place"): "{x_m: 3, y_m: 4}",
            ("drawing", "pads"): "file",
            ("fence", "distance_max_m"): "12",
            ("fence", "height_max_m"): "9",
        },
    )
    assert Source(changed, "a.yaml").value() == {
        "drawing": {"pads": "file", "source": "a.skyc", "place": {"x_m": 3, "y_m": 4}, "late": "wait"},
        "fence": {"height_max_m": 9, "distance_max_m": 12},
    }
    assert "# of the stage" in changed
    with pytest.raises(KeyError):
        source.changed(BLOCKS, {("fleet", "pads"): "4"})


def standing(night: LoadedShow, noise_m: float = 0.0, seed: int = 1) -> Array:
    """Vehicles on the pads of THERE, in a random order."""
    random = np.random.default_rng(seed)
    pads_m = placed_pads_m(night.show, THERE)
    return random.permutation(pads_m) + random.normal(0.0, noise_m, pads_m.shape)


@pytest.mark.parametrize("seed", range(3))
def test_pads_are_fitted_to_vehicles_in_any_order(night: LoadedShow, seed: int) -> None:
    standing_m = standing(night, 0.1, seed)
    found = fitted(night.show, placement(0.0, 0.0, 0.0), standing_m)
    assert (found.x_m, found.y_m) == pytest.approx((THERE.x_m, THERE.y_m), abs=0.3)
    assert found.turn_deg == pytest.approx(THERE.turn_deg, abs=2.0)
    beside = stand(night.show, found, standing_m)
    assert sorted(beside.pad.tolist()) == list(range(12))
    assert beside.rms_m < 0.2
    assert beside.rms_m <= stand(night.show, THERE, standing_m).rms_m + 1e-3


@pytest.mark.parametrize(("begin_deg", "expected_deg"), [(0.0, 35.0), (180.0, -145.0)])
def test_of_equal_fits_the_least_turn_counts(
    night: LoadedShow, begin_deg: float, expected_deg: float
) -> None:
    """A rectangle looks the same turned by half a turn; the audience is on one side."""
    found = fitted(night.show, placement(0.0, 0.0, begin_deg), standing(night))
    assert found.turn_deg == pytest.approx(expected_deg, abs=0.05)


def test_a_misplaced_vehicle_is_seen(night: LoadedShow) -> None:
    standing_m = standing(night)
    standing_m[4] += (2.0, 0.0)
    beside = stand(night.show, fitted(night.show, placement(0, 0, 0), standing_m), standing_m)
    assert int(np.argmax(beside.off_m)) == 4
    assert beside.off_m[4] > 1.5


def test_vehicles_without_a_position_or_a_pad_have_none(night: LoadedShow) -> None:
    standing_m = np.concatenate([standing(night), [[100.0, 100.0]]])
    standing_m[2] = np.nan
    beside = stand(night.show, THERE, standing_m)
    assert beside.pad[2] == -1
    assert np.isnan(beside.off_m[2])
    assert np.isfinite(beside.off_m[12])  # the pad that is left, far away
    with pytest.raises(RefusedError, match="nothing to fit to"):
        fitted(night.show, THERE, np.full((12, 2), np.nan))


def test_a_few_vehicles_are_fitted_where_the_show_nearly_lies(night: LoadedShow) -> None:
    near = placement(THERE.x_m + 0.5, THERE.y_m - 0.4, THERE.turn_deg + 2.0)
    some_m = standing(night)[:7]
    beside = stand(night.show, fitted(night.show, near, some_m), some_m)
    assert beside.rms_m < 0.01


def test_a_file_in_the_fleets_order_keeps_that_order(night: LoadedShow) -> None:
    ordered = placed(night, text_of(night).replace("drawing: {", "drawing: {pads: file, "))
    in_order_m = placed_pads_m(night.show, THERE)
    found = fitted(ordered.show, placement(0.0, 0.0, 170.0), in_order_m)
    assert (found.x_m, found.y_m, found.turn_deg) == pytest.approx((12.0, -7.5, 35.0), abs=0.02)
    swapped_m = in_order_m[[1, 0, *range(2, 12)]]
    assert stand(ordered.show, THERE, swapped_m).off_m[:2].min() > 2.0
    assert stand(night.show, THERE, swapped_m).off_m.max() < 0.01
    more_m = np.concatenate([in_order_m, [[300.0, 0.0]]])  # a vehicle for which the show has no pad
    assert fitted(ordered.show, THERE, more_m) == found


def test_a_show_of_another_origin_keeps_its_place_on_earth(night: LoadedShow) -> None:
    frame = replace(ORIGIN, latitude_deg=ORIGIN.latitude_deg + 1e-4, heading_deg=100.0)
    here = in_frame(night.show, frame)
    assert here.turn_deg == pytest.approx(-60.0)
    by_earth_m = frame.position_m(*ORIGIN.geodetic(night.show.pads_m))
    assert here.placed_m(night.show.drawn_pads_m)[:, :2] == pytest.approx(by_earth_m[:, :2], abs=0.02)
    moved = at_there(night, frame)
    assert moved.show.origin.heading_deg == 100.0
    assert in_frame(moved.show, frame) == THERE
    assert in_frame(night.show, replace(ORIGIN, latitude_deg=-33.0)) == placement(0.0, 0.0, 0.0)


def test_a_vehicle_stands_on_the_pad_that_is_next_to_it() -> None:
    pads_m = np.array([[0.0, 0.0], [0.0, 4.0], [4.0, 0.0]])
    standing_m = np.array([[4.2, 0.1], [0.3, 0.0], [np.nan, np.nan], [0.9, 0.0], [2.0, 2.0]])
    assert standing_on(pads_m, standing_m, 1.0).tolist() == [2, 0, -1, -1, -1]
