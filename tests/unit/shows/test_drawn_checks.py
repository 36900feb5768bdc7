"""The check of a drawing without a flight: what is refused, where, and what the file claims."""

import re
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from gcs.model.errors import ShowError
from gcs.shows import Flaw, load
from gcs.shows.drawn import Claims, DrawnShow, YawPrograms
from gcs.shows.drawn.yaw_programs import YawProgram
from gcs.shows.drawn_checks import DrawnFigures, drawn_within, examine
from gcs.shows.formats import parse_drawing, read_drawing, write_drawing
from gcs.shows.importing import show_text
from gcs.simulation.drawn_traffic import ORIGIN
from tests.support.drawing_files import flight, skyc, zipped
from tests.support.drawn_shows import drawn_show


def checked(
    folder: Path, show: DrawnShow, changes: tuple[str, str] = ("", "")
) -> tuple[DrawnFigures, list[Flaw]]:
    source = folder / "trial.skyc"
    write_drawing(show, source)
    drawing, data = read_drawing(source)
    path = folder / "trial.yaml"
    text = show_text(drawing, source.name, sha256(data).hexdigest()).replace(*changes)
    path.write_text(text)
    return examine(load(path).timeline)


def test_a_show_at_three_metres_is_good(tmp_path: Path) -> None:
    figures, flaws = checked(tmp_path, drawn_show(12, 40.0, 3.0, ("wall",)))
    assert flaws == []
    assert figures.separation_min_m == pytest.approx(3.0, abs=0.1)
    assert figures.pairs_below_floor == 0
    assert all(claim.holds for claim in figures.claims)
    assert len(figures.claims) == 5


def test_spacing_below_the_floor_is_refused_with_pairs_and_times(tmp_path: Path) -> None:
    figures, flaws = checked(tmp_path, drawn_show(12, 40.0, 1.5, ("wall",)))
    assert figures.pairs_below_floor > 0
    assert {flaw.loc[0] for flaw in flaws} == {"timeline"}
    assert "are drawn closer than the floor of 2 m: drone 1 and drone 5 1.53 m at 7.5 s" in flaws[0].text


def test_the_pair_that_is_drawn_too_close_is_named(tmp_path: Path) -> None:
    checked(tmp_path, drawn_show(9, 40.0, 3.0, ("cube",)))
    timeline = load(tmp_path / "trial.yaml").timeline
    assert drawn_within(timeline, 4, (2.9, 4.3), 40.0) == ""
    named = drawn_within(timeline, 4, (4.0, 6.9), 40.0)
    assert named.startswith("drone 5 and drone ")
    assert drawn_within(timeline, 4, (4.0, 6.9), 0.0) == ""
    apart_m, up_m, at_s = map(float, re.findall(r"[0-9]+\.[0-9]+", named))
    assert np.hypot(apart_m, up_m / 1.5) == pytest.approx(3.0, abs=0.1)
    motion = timeline.motion_at(at_s)
    assert motion is not None
    away_m = np.abs(motion.position_m - motion.position_m[4])
    assert np.isclose(np.hypot(away_m[:, 0], away_m[:, 1]), apart_m, atol=0.006).any()


def test_a_yaw_that_turns_too_fast_is_refused_where_flown(tmp_path: Path) -> None:
    show = drawn_show(8, 40.0, 3.0, ("rings",))
    whirl = YawProgram(np.array([0.0, 20.0, 22.0]), np.radians([0.0, 90.0, 270.0]))
    show = replace(show, yaw=YawPrograms.joined([whirl] * 8))
    assert checked(tmp_path, show)[1] == []
    _, flaws = checked(tmp_path, show, (".skyc, sha256", ".skyc, yaw: drawn, sha256"))
    assert "90.00 deg/s of yaw, at most 45 deg/s: vehicle" in flaws[0].text


def test_a_claim_that_does_not_hold_is_reported(tmp_path: Path) -> None:
    show = replace(
        drawn_show(8, 40.0, 3.0, ("rings",)), claims=Claims(separation_min_m=4.5, speed_max_m_s=0.1)
    )
    figures, flaws = checked(tmp_path, show)
    assert [(claim.name, claim.holds) for claim in figures.claims] == [
        ("separation_min_m", False),
        ("speed_max_m_s", False),
    ]
    assert flaws == []


@pytest.mark.parametrize(
    ("limit", "reported"),
    [
        ("limits: {speed_max_m_s: 0.5}", "m/s sideways, at most 0.5 m/s: vehicle"),
        ("limits: {climb_max_m_s: 0.5}", "m/s up, at most 0.5 m/s: vehicle"),
        ("limits: {sink_max_m_s: 0.5}", "m/s down, at most 0.5 m/s: vehicle"),
    ],
)
def test_what_no_vehicle_can_follow_is_refused(tmp_path: Path, limit: str, reported: str) -> None:
    _, flaws = checked(
        tmp_path, drawn_show(8, 40.0, 3.0, ("rings",)), ("\nduration_s", f"\n{limit}\nduration_s")
    )
    assert flaws
    assert all(reported in flaw.text for flaw in flaws)


def test_a_drawing_above_the_fence_is_refused(tmp_path: Path) -> None:
    show = drawn_show(8, 40.0, 3.0, ("rings",))
    high_m = -float(show.trajectories.hull_m()[0, 2])
    _, flaws = checked(
        tmp_path, show, (f"height_max_m: {int(high_m + 11)}", f"height_max_m: {int(high_m - 1)}")
    )
    assert any("m above the fence" in flaw.text for flaw in flaws)


def fenced(folder: Path, *polygons: tuple[bool, list[list[float]]], place: str = "") -> list[Flaw]:
    """Return the flaws of two drones that climb at (0, 0) and (6, 0) of the drawing, with this geofence."""
    drones = [
        flight(*([at_s, [x_m, 0, z_m]] for at_s, z_m in ((0, 0), (20, 10), (40, 10), (60, 0))))
        for x_m in (0, 6)
    ]
    written = [{"isInclusion": inside, "points": points} for inside, points in polygons]
    settings = {"geofence": {"version": 1, "polygons": written}}
    data = zipped(skyc(*drones, settings=settings))
    (folder / "trial.skyc").write_bytes(data)
    drawing = parse_drawing(data, "trial.skyc")
    text = show_text(drawing, "trial.skyc", sha256(data).hexdigest(), origin=ORIGIN)
    (folder / "trial.yaml").write_text(text.replace("{source:", f"{{{place}source:"))
    return examine(load(folder / "trial.yaml").timeline)[1]


AROUND = [[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]]
WIDE = [[-5.0, -5.0], [12.0, -5.0], [12.0, 5.0], [-5.0, 5.0]]
THERE = [[5.0, -1.0], [7.0, -1.0], [7.0, 1.0], [5.0, 1.0]]


def test_a_drawing_beyond_its_own_fence_is_refused(tmp_path: Path) -> None:
    """With vehicle, time and place; its pad as well."""
    pads, drawn = fenced(tmp_path, (True, AROUND))
    assert "pad 2 is 4.00 m beyond the fence of the drawing" in pads.text
    assert "drone 2 is 4.00 m beyond the fence of the drawing at" in drawn.text
    assert "x 6.0 m, y 0.0 m" in drawn.text
    pads, drawn = fenced(tmp_path, (True, WIDE), (False, THERE))
    assert "pad 2 is 1.00 m beyond" in pads.text
    assert "drone 2 is 1.00 m beyond" in drawn.text


def test_a_drawing_within_its_fence_is_good(tmp_path: Path) -> None:
    assert fenced(tmp_path, (True, WIDE)) == []
    assert fenced(tmp_path, (True, [*WIDE, WIDE[0]])) == []
    assert fenced(tmp_path, (False, [[20.0, 0.0], [30.0, 0.0], [25.0, 9.0]])) == []


def test_the_fence_is_placed_with_the_drawing(tmp_path: Path) -> None:
    assert fenced(tmp_path, (True, WIDE), place="place: {x_m: 4, y_m: -3, turn_deg: 77}, ") == []
    assert len(fenced(tmp_path, (True, AROUND), place="place: {x_m: 4, y_m: -3, turn_deg: 77}, ")) == 2


def test_a_fence_with_too_many_corners_is_refused(tmp_path: Path) -> None:
    """It would not be kept in flight."""
    angle = np.linspace(0.0, 2.0 * np.pi, 99, endpoint=False)
    circle = (30.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)).tolist()
    with pytest.raises(ShowError, match="1 areas with up to 99 corners: at most 4 with 60 are kept"):
        fenced(tmp_path, (True, circle))
