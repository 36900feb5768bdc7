"""Show files with a drawing: what an import writes, and what is wrong with one, by line and cue."""

from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from gcs.config.sections import OperationSettings
from gcs.config.yaml_files import shipped_folder
from gcs.model.errors import ConfigError, ShowError
from gcs.model.frames import ShowFrame
from gcs.shows import LoadedShow, load, parse
from gcs.shows.drawn import DrawnShow
from gcs.shows.formats import parse_drawing, read_drawing
from gcs.shows.importing import flown_s, pads_of, show_text
from gcs.shows.loading import service_flaws
from tests.support.drawing_files import flight, skyc, zipped
from tests.support.show_files import BEGIN, SOUND

SHIPPED = shipped_folder() / "shows" / "drawn-30.skyc"


@pytest.fixture(scope="module")
def shipped() -> tuple[DrawnShow, bytes]:
    return read_drawing(SHIPPED)


@pytest.fixture
def written(shipped: tuple[DrawnShow, bytes], tmp_path: Path) -> Callable[..., LoadedShow]:
    """Load a show of the shipped drawing, with changed keys."""
    drawing, data = shipped
    (tmp_path / "a.skyc").write_bytes(data)

    def load_changed(**changes: Any) -> LoadedShow:
        text = show_text(drawing, "a.skyc", sha256(data).hexdigest())
        return parse(
            yaml.safe_dump(yaml.safe_load(text) | changes, sort_keys=False), str(tmp_path / "a.yaml")
        )

    return load_changed


def _problems(written: Callable[..., LoadedShow], **changes: Any) -> list[tuple[str | None, str]]:
    with pytest.raises(ShowError) as raised:
        written(**changes)
    return [(problem.cue, problem.text) for problem in raised.value.problems]


def test_the_shipped_drawing_is_flyable(shipped: tuple[DrawnShow, bytes]) -> None:
    """30 vehicles, 70 s, above the pads at both ends; within 4 m/s, 2 m/s^2, and climb and sink of a show."""
    show, _ = shipped
    assert (len(show), show.duration_s, show.claims.separation_min_m) == (30, 70.0, 3.0)
    motions = [show.trajectories.at(time_s) for time_s in np.arange(0.0, 70.01, 0.05).tolist()]
    velocity_m_s = np.stack([motion.velocity_m_s for motion in motions])
    assert np.linalg.norm(velocity_m_s, axis=2).max() <= 4.0
    assert velocity_m_s[:, :, 2].min() >= -2.5
    assert velocity_m_s[:, :, 2].max() <= 1.4
    assert max(np.linalg.norm(motion.acceleration_m_s2, axis=1).max() for motion in motions) <= 2.0
    for motion in (motions[0], motions[-1]):
        assert np.sort(motion.position_m, axis=0) == pytest.approx(
            np.sort(show.home_m - (0, 0, 5.0), axis=0), abs=0.01
        )


def test_an_import_writes_a_show_without_flaws(
    shipped: tuple[DrawnShow, bytes], written: Callable[..., LoadedShow]
) -> None:
    drawing, _ = shipped
    loaded = written()
    assert loaded.drawing is not None
    assert (loaded.show.kind, loaded.show.fleet.vehicles) == ("trajectories", 30)
    assert [cue.cue for cue in loaded.show.timeline] == [cue.name for cue in drawing.cues]
    assert loaded.show.pads_m[:, :2] == pytest.approx(drawing.home_m[:, :2], abs=0.05)
    least_m, most_m = drawing.trajectories.hull_m()
    assert loaded.show.fence.height_max_m > -least_m[2]
    assert loaded.show.fence.distance_max_m > np.hypot(*most_m[:2])


def test_the_timeline_tells_the_time_of_the_drawing(written: Callable[..., LoadedShow]) -> None:
    timeline = written().timeline
    assert [timeline.drawn_s(time_s) for time_s in (0.0, 33.3, 70.0)] == pytest.approx([0.0, 33.3, 70.0])


def test_drawn_parts_and_cues_of_the_law_make_one_show(written: Callable[..., LoadedShow]) -> None:
    """Drawn for 20 s, then the sphere, then drawn again from another time on."""
    drawn, again = (
        {"trajectories": part} for part in ({"from_s": 10.0, "to_s": 30.0}, {"from_s": 40.0, "to_s": 70.0})
    )
    sphere = {"cue": "sphere", "at_s": 20, "radius_m": 14, "height_m": 25, "target": {"x_m": 5, "y_m": 0}}
    cues = [{"cue": "first", "at_s": 0, **drawn}, sphere, {"cue": "last", "at_s": 60, **again}]
    timeline = written(
        timeline=cues, duration_s=95.0, fence={"height_min_m": 3, "height_max_m": 60, "distance_max_m": 60}
    ).timeline
    assert [timeline.drawn_s(time_s) for time_s in (5.0, 19.9)] == pytest.approx([15.0, 29.9])
    assert timeline.drawn_s(40.0) is None
    assert timeline.plan_at(40.0).formation.radius_m == 14.0
    assert [timeline.drawn_s(time_s) for time_s in (61.0, 94.0)] == pytest.approx([41.0, 70.0])


@pytest.mark.parametrize(
    ("cues", "cue", "problem"),
    [
        (
            [{"cue": "a", "at_s": 0, "trajectories": {"from_s": 60, "to_s": 99}}],
            "a",
            "to_s = 99: the drawing ends at 70 s",
        ),
        (
            [{"cue": "a", "at_s": 0, "trajectories": {"from_s": 9, "to_s": 9}}],
            "a",
            "to_s = 9: after from_s, 9 s",
        ),
        (
            [{"cue": "a", "at_s": 0, "trajectories": {"to_s": 9}, "radius_m": 9}],
            "a",
            "radius_m: not beside trajectories, which say it themselves",
        ),
        (
            [
                {"cue": "a", "at_s": 0, "trajectories": {"to_s": 20}},
                {"cue": "b", "at_s": 15, "trajectories": {"to_s": 9}},
            ],
            "a",
            "it plays until 20.000 s, the next cue begins at 15 s",
        ),
        (
            [{"cue": "a", "at_s": 0, "trajectories": {"to_s": 9}}, {"cue": "b", "at_s": 9, "target": "live"}],
            "b",
            "radius_m is missing: the first cue without trajectories says where the formation begins",
        ),
        (
            [
                {**BEGIN, "radius_m": 14, "height_m": 20},
                {"cue": "grow", "at_s": 5, "radius_m": 18, "over_s": 20},
                {"cue": "b", "at_s": 15, "trajectories": {"to_s": 9}},
            ],
            "b",
            "radius_m of 'grow' is on its way until 25.0 s",
        ),
    ],
)
def test_a_wrong_drawn_part_is_named(
    written: Callable[..., LoadedShow], cues: list[dict[str, Any]], cue: str, problem: str
) -> None:
    found = _problems(written, timeline=cues)
    assert any(named == cue and problem in text for named, text in found), found


def test_a_part_beyond_the_show_is_named(written: Callable[..., LoadedShow]) -> None:
    assert "the show ends at 60 s" in _problems(written, duration_s=60.0)[0][1]


def test_a_changed_or_missing_drawing_is_refused(written: Callable[..., LoadedShow], tmp_path: Path) -> None:
    (tmp_path / "a.skyc").write_bytes(zipped(skyc(flight([0, [0, 0, 5]]))))
    assert "it has changed, import it again" in _problems(written)[0][1]
    (tmp_path / "a.skyc").unlink()
    assert "No such file" in _problems(written)[0][1]


def test_a_drawing_outside_the_folder_cannot_be_named(written: Callable[..., LoadedShow]) -> None:
    drawing = {"source": "../secret.skyc", "sha256": "0" * 64}
    assert any("source" in text for _, text in _problems(written, drawing=drawing))


def test_kind_and_drawing_go_together(written: Callable[..., LoadedShow], tmp_path: Path) -> None:
    assert "kind = formation" in _problems(written, kind="formation")[0][1]
    text = yaml.safe_dump(SOUND | {"timeline": [BEGIN], "kind": "trajectories"})
    with pytest.raises(ShowError, match="kind = trajectories: 'trajectories' with a drawing"):
        parse(text, str(tmp_path / "b.yaml"))


def test_another_number_of_vehicles_is_refused(written: Callable[..., LoadedShow]) -> None:
    fleet = {"vehicles": 29, "pads": {"columns": 6, "spacing_m": 4.25}, "endurance_s": 900.0}
    assert "vehicles = 29: the drawing has 30 vehicles" in _problems(written, fleet=fleet)[0][1]


def test_pads_are_exchanged_where_vehicles_end_low_over_others(written: Callable[..., LoadedShow]) -> None:
    """The shipped drawing leads its vehicles back to 5 m above the pads, not each to its own."""
    drawing = written().show.drawing
    assert drawing is not None
    assert drawing.lands == "nearest"


def test_pads_are_kept_where_a_drawing_ends_over_them(tmp_path: Path) -> None:
    up, over = [0, 0, 6], [9, 0, 6]
    data = zipped(skyc(flight([0, up], [9, up]), flight([0, over], [9, over])))
    (tmp_path / "b.skyc").write_bytes(data)
    drawing = parse_drawing(data, "b.skyc")
    text = show_text(drawing, "b.skyc", sha256(data).hexdigest(), origin=ShowFrame(47.0, 8.0, 400.0, 0.0))
    found = parse(text, str(tmp_path / "b.yaml")).show.drawing
    assert found is not None
    assert found.lands == "own"


def test_exchanged_pads_need_vehicles_that_wait_for_commands(
    written: Callable[..., LoadedShow],
) -> None:
    show, frame = written().show, written().show.origin.frame
    for action, refused in (("return", True), ("hold", False)):
        operation = OperationSettings.model_validate({"setpoint_loss_action": action})
        found = service_flaws(show, frame, show.control, operation, 30)
        assert (
            any("the service's operation.setpoint_loss_action is 'return'" in one.text for one in found)
            == refused
        )


def test_spares_are_for_a_cue_of_the_show(written: Callable[..., LoadedShow]) -> None:
    drawing = written().show.drawing
    assert drawing is not None
    named = drawing.model_dump(exclude_none=True)
    spares = {"count": 2, "before_cue": "2 rings"}
    assert written(drawing=named | {"spares": spares}).show.drawing is not None
    wrong = named | {"spares": spares | {"before_cue": "nowhere"}}
    assert "before_cue = nowhere: the name of a cue" in _problems(written, drawing=wrong)[0][1]


def test_the_drawings_yaw_is_flown_where_the_show_asks_for_it(written: Callable[..., LoadedShow]) -> None:
    drawing = written().show.drawing
    assert drawing is not None
    named = drawing.model_dump(exclude_none=True)
    assert written().timeline.yaw_at(10.0) is None
    yaw_rad = written(drawing=named | {"yaw": "drawn"}).timeline.yaw_at(10.0)
    assert yaw_rad is not None
    assert yaw_rad.tolist() == pytest.approx([np.pi * 10.0 / 70.0] * 30)


def test_the_hash_covers_the_drawing(written: Callable[..., LoadedShow]) -> None:
    show = written().show
    assert show.drawing is not None
    other = show.model_copy(update={"drawing": show.drawing.model_copy(update={"sha256": "0" * 64})})
    assert other.digest != show.digest


def test_take_off_and_landing_of_a_drawing_are_left_out(tmp_path: Path) -> None:
    """Two drones rise one after the other from the ground and land so; between, all are 5 m or higher."""
    ground, up = [0, 0, 0], [0, 0, 6]
    first = flight([0, ground], [6, up], [40, up], [46, ground])
    second = flight([4, [9, 0, 0]], [10, [9, 0, 6]], [44, [9, 0, 6]], [50, [9, 0, 0]])
    data = zipped(skyc(first, second))
    drawing = parse_drawing(data, "b.skyc")
    assert flown_s(drawing) == pytest.approx((9.0, 41.0), abs=0.26)
    text = show_text(drawing, "b.skyc", sha256(data).hexdigest(), origin=ShowFrame(47.0, 8.0, 400.0, 0.0))
    (tmp_path / "b.skyc").write_bytes(data)
    (tmp_path / "b.yaml").write_text(text)
    (part,) = load(tmp_path / "b.yaml").timeline.parts
    assert (part.from_s, part.to_s) == pytest.approx((9.0, 41.0), abs=0.26)


def test_without_a_place_on_earth_an_origin_is_needed() -> None:
    drawing = parse_drawing(zipped(skyc(flight([0, [0, 0, 5]], [9, [0, 0, 6]]))), "b.skyc")
    with pytest.raises(ConfigError, match="give the show's origin"):
        show_text(drawing, "b.skyc", "0" * 64)


def test_a_drawing_that_stays_on_the_ground_is_refused() -> None:
    drawing = parse_drawing(zipped(skyc(flight([0, [0, 0, 0]], [9, [0, 0, 1]]))), "b.skyc")
    with pytest.raises(ConfigError, match="all vehicles are never 3 m or higher together"):
        show_text(drawing, "b.skyc", "0" * 64, origin=ShowFrame(47.0, 8.0, 400.0, 0.0))


@pytest.mark.parametrize(("count", "columns"), [(1, 1), (12, 4), (11, 4)])
def test_homes_on_a_grid_keep_their_columns(count: int, columns: int) -> None:
    index = np.arange(count)
    home_m = np.stack([5.0 * (index // 4), 5.0 * (index % 4), 0.0 * index], axis=1)
    found, spacing_m, (x_m, y_m) = pads_of(home_m)
    assert found == columns
    assert spacing_m == (5.0 if count > 1 else 3.0)
    assert (x_m, y_m) == ((0.0, 0.0) if count == 1 else (5.0, 7.5))


def test_other_homes_become_a_square_grid_at_a_safe_spacing() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 20, endpoint=False)
    home_m = np.stack([3.0 * np.cos(angle), 3.0 * np.sin(angle), 0.0 * angle], axis=1)
    assert pads_of(home_m)[:2] == (5, 3.0)
