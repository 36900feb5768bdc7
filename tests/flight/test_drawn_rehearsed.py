"""Shows with drawn parts in virtual time, as `gcs show check` flies them."""

from dataclasses import asdict
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
import yaml

from gcs.shows import LoadedShow, load
from gcs.shows.formats import read_drawing, write_drawing
from gcs.shows.importing import show_text
from gcs.simulation.rehearsal import Rehearsal, rehearse
from gcs.simulation.scenario import Adversity, ScenarioBox, ScenarioLoss, World
from gcs.simulation.verdict import judge, table
from tests.support.drawn_shows import drawn_show
from tests.support.imports_flown import PHYSICAL

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


@pytest.mark.soak
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


@pytest.mark.soak
def test_the_clock_waits_until_a_part_can_begin(mixed: Rehearsal) -> None:
    show_s = np.array(mixed.show_s)
    waited_s = float(np.count_nonzero(np.abs(show_s - 40.0) < 0.06)) * mixed.world.tick_s
    assert 3.0 < waited_s < 60.0
    errors_m = np.stack(mixed.off_m)[np.flatnonzero(show_s[: len(mixed.off_m)] > 40.2)]
    assert np.nanmax(errors_m[:20]) < 1.0


@pytest.mark.soak
def test_lags_name_every_vehicle_the_farthest_first(mixed: Rehearsal) -> None:
    lags = judge(mixed).lags
    assert sorted(lag.vehicle for lag in lags) == list(range(1, 9))
    sizes = [lag.max_m for lag in lags]
    assert sizes == sorted(sizes, reverse=True)
    assert {asdict(lag)["trajectory"] for lag in lags} == {f"drone {number}" for number in range(1, 9)}


@pytest.fixture(scope="module")
def rings(tmp_path_factory: pytest.TempPathFactory) -> LoadedShow:
    """Eight vehicles, 6 m apart, that end 5 m above pads, most of them above another's."""
    folder: Path = tmp_path_factory.mktemp("rings")
    write_drawing(drawn_show(8, 30.0, 6.0, ("rings",)), folder / "rings.skyc")
    drawing, data = read_drawing(folder / "rings.skyc")
    (folder / "rings.yaml").write_text(show_text(drawing, "rings.skyc", sha256(data).hexdigest()))
    return load(folder / "rings.yaml")


@pytest.mark.soak
def test_vehicles_land_on_the_pads_below_where_a_drawing_ends(rings: LoadedShow) -> None:
    flight = Rehearsal(rings, QUIET, 1)
    flight.fly()
    assert judge(flight).good, judge(flight).problems
    begun = int(np.searchsorted(flight.record.time_s, flight.ended_s or 0.0))
    path_m = flight.record.path_m[begun:, :, :2]
    assert np.linalg.norm(path_m - path_m[0], axis=2).max() < 3.0
    to_pads_m = np.linalg.norm(path_m[-1][:, None] - rings.show.pads_m[None, :, :2], axis=2)
    assert sorted(to_pads_m.argmin(axis=1).tolist()) == list(range(8))
    assert to_pads_m.min(axis=1).max() < 1.5


@pytest.mark.soak
def test_losses_wind_and_an_unknown_crane_are_rehearsed(rings: LoadedShow) -> None:
    """One of eight vehicles is lost, and a crane stands where the rings lead vehicles through."""
    crane = ScenarioBox(x_m=15.0, y_m=2.5, half_length_x_m=1.0, half_length_y_m=1.0, height_m=40.0)
    adversity = Adversity(loss=ScenarioLoss(share=0.125, at_s=15.0), boxes=(crane,))
    verdict = judge(rehearse(rings, 3, adversity=adversity, wind_m_s=(6.4, 4.8)))
    assert verdict.good, verdict.problems
    assert (verdict.pairs_below_floor, verdict.penetrations) == (0, 0)
    (lost,) = verdict.lost
    assert lost in range(1, 9)
    assert {lag.vehicle for lag in verdict.lags} == set(range(1, 9))
    text = table(verdict)
    assert f"lost on purpose: {lost}" in text
    assert "0 vehicles came within 1 m of an obstacle" in text


@pytest.fixture(scope="module")
def spared(rings: LoadedShow) -> LoadedShow:
    """The same with one spare on the ground, which takes off for a vehicle lost before the way back."""
    raw = yaml.safe_load(Path(rings.file).read_text())
    raw["drawing"] |= {"spares": {"count": 1, "before_cue": "2 back"}}
    path = Path(rings.file).with_name("spared.yaml")
    path.write_text(yaml.safe_dump(raw, sort_keys=False))
    return load(path)


def lost_at(show: LoadedShow, at_s: float, share: float = 0.125, action: str = "hold") -> Rehearsal:
    """Rehearse with vehicles lost so long after the assembly began."""
    loss = ScenarioLoss.model_validate({"share": share, "at_s": at_s, "action": action})
    flight = Rehearsal(show, QUIET, 3, adversity=Adversity(loss=loss))
    flight.fly()
    return flight


@pytest.mark.soak
def test_a_spare_takes_the_place_of_a_lost_vehicle(spared: LoadedShow) -> None:
    flight = lost_at(spared, 12.0)
    verdict = judge(flight)
    assert verdict.good, verdict.problems
    ((lost,), (one,)) = verdict.lost, verdict.replaced
    assert (one.lost, one.spare, verdict.not_replaced) == (lost, 9, ())
    assert one.there_s is not None
    assert one.at_s < one.there_s < verdict.show_s
    assert one.separation_min_m is not None
    assert one.separation_min_m >= verdict.floor_m
    assert flight.trajectory_of[8] == flight.trajectory_of[lost - 1]
    away_m = np.linalg.norm(flight.record.path_m[-1, 8, :2] - spared.show.start_places_m[8, :2])
    assert away_m < 1.5, "it lands on its own place"
    assert f"9 takes the place of {lost}" in table(verdict)


@pytest.mark.soak
def test_a_vehicle_lost_after_the_cue_is_not_replaced(spared: LoadedShow) -> None:
    (cue_s,) = [one.at_s for one in spared.timeline.played if one.cue.cue == "2 back"]
    flight = lost_at(spared, cue_s + 10.0)
    verdict = judge(flight)
    assert (verdict.replaced, verdict.not_replaced) == ((), verdict.lost)
    assert not np.array(flight.record.in_air)[:, 8].any()
    assert f"no spare takes the place of {verdict.lost[0]}" in table(verdict)


@pytest.mark.soak
def test_loss_of_the_station_is_predicted_as_it_would_be_flown(rings: LoadedShow) -> None:
    """Seven of eight vehicles lose their links at a time for which one action is predicted to be unsafe."""
    flight = Rehearsal(rings, QUIET, 3)
    flight.fly()
    hold, returns, land = judge(flight).control_loss
    assert (hold.action, returns.action, land.action) == ("hold", "return", "land")
    assert min(each.moments for each in (hold, returns, land)) >= 8
    assert land.unsafe > 0, "one ring is above the other"
    assert land.at_s is not None
    at_s = land.at_s + (flight.began_s or 0.0)
    assert min(lost_at(rings, at_s, 0.87, "land").record.closest_m) < flight.record.floor_m
    text = table(judge(flight))
    assert (
        f"land or descend: {land.pairs} pairs below the floor, at {land.unsafe} of {land.moments} moments"
        in text
    )
    assert hold.closest is None
    assert "hold: all stay apart" in text
    assert min(lost_at(rings, at_s, 0.87, "hold").record.closest_m) >= flight.record.floor_m


@pytest.mark.soak
def test_an_obstacle_on_a_vehicle_is_reported(rings: LoadedShow) -> None:
    x_m, y_m, _ = rings.show.pads_m[0].tolist()
    wall = ScenarioBox(x_m=x_m, y_m=y_m, half_length_x_m=1.0, half_length_y_m=1.0, height_m=9.0)
    flight = Rehearsal(rings, QUIET, 1, adversity=Adversity(boxes=(wall,)))
    assert any("unknown box 1" in flaw.text for flaw in flight.flaws)


@pytest.mark.soak
def test_a_pair_drawn_too_close_is_named_where_it_leads_far_off(tmp_path: Path) -> None:
    """Three layers, closer one above the other than the filter keeps, right below the fence."""
    write_drawing(drawn_show(9, 25.0, 2.5, ("cube",), 183), tmp_path / "cube.skyc")
    drawing, data = read_drawing(tmp_path / "cube.skyc")
    raw = yaml.safe_load(show_text(drawing, "cube.skyc", sha256(data).hexdigest()))
    top_m = float(-drawing.trajectories.hull_m()[0, 2])
    raw["fence"] |= {"height_max_m": round(top_m + 0.1, 1)}
    raw["drawing"] |= {"waits_from_m": 1.0}
    (tmp_path / "cube.yaml").write_text(yaml.safe_dump(raw, sort_keys=False))
    verdict = judge(rehearse(load(tmp_path / "cube.yaml")))
    (problem,) = verdict.problems
    assert verdict.fence_height_margin_m < 0.0
    assert f"is {-verdict.fence_height_margin_m:.2f} m above the fence at" in problem.text
    assert PHYSICAL.search(problem.text)
    (far,) = (words for words in verdict.warnings if "from its trajectory" in words)
    assert far.startswith(f"vehicle {verdict.lags[0].vehicle} is at ")
    assert far.endswith("inside of the 4.0 m and 6.8 m that the filter keeps")
