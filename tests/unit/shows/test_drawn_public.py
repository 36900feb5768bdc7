"""Drawings as programs in the field write them: comments, folders above, odd names, lights that go on."""

import json
from base64 import b64encode
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs.cli.main import main
from gcs.flight.state.running_show import ShowRun
from gcs.model.errors import ConfigError, DrawingError
from gcs.model.frames import ShowFrame
from gcs.model.lifecycle import ShowPhase
from gcs.shows import load
from gcs.shows.drawn import DrawnShow
from gcs.shows.drawn_checks import examine
from gcs.shows.formats import parse_drawing, write_drawing
from gcs.shows.importing import show_file
from gcs.shows.service_rules import ServiceRules
from tests.support.drawing_files import HOVER, flight, light, skyc, zipped
from tests.support.imports_flown import GENERATORS, NAMES

WHITE, RED, BLACK = [255, 255, 255], [255, 0, 0], [0, 0, 0]
PLACE = ShowFrame(47.0, 8.0, 400.0, 0.0)


def polynomial(seconds: float, z_m: float, z_m_s: float) -> str:
    """A row of uav_trajectories: straight up or down."""
    row = [0.0] * 33
    row[0], row[17], row[18] = seconds, z_m, z_m_s
    return ",".join(f"{value:g}" for value in row)


UP, DOWN = polynomial(6, 4, 1), polynomial(6, 10, -1)


@pytest.mark.parametrize(
    "text",
    [
        f"{NAMES}\n{UP}\n{DOWN}\n",
        f"{NAMES},\n{UP},\n{DOWN},\n",
        f"{NAMES}\r\n{UP},\r\n{DOWN},\r\n\r\n",
        f"{NAMES}\n\n# up\n{UP}\n\n# down\n{DOWN}\n",
        f"# made by hand\n{NAMES}\n  {UP}  # up\n{DOWN}",
        f"#{NAMES}\n{UP}\n{DOWN}\n# end",
        f'"{NAMES}"\n{UP},\n{DOWN}\n',
        f"\ufeff{UP}\n{DOWN},\n",
    ],
)
@pytest.mark.parametrize("zip_of_them", [False, True])
def test_polynomials_are_read_as_they_are_in_public(text: str, zip_of_them: bool) -> None:
    """Commas at the ends of rows, comments, empty lines: their own reader takes columns 0 to 32, too."""
    data = zipped({"cf1.csv": text}) if zip_of_them else text.encode()
    show = parse_drawing(data, "a.zip" if zip_of_them else "a.csv")
    assert (len(show), show.duration_s) == (1, 12.0)
    assert [-show.trajectories.at(at_s).position_m[0, 2] for at_s in (0.0, 6.0, 12.0)] == pytest.approx(
        [4, 10, 4]
    )
    assert show.lights.colours_at(3.0).tolist() == [WHITE]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (f"{NAMES}\n# up\n{UP},1\n{DOWN}\n", "line 4 has 33 values, 34 as before"),
        (f"{NAMES}\n{UP}\n\n{UP},,\n", "line 4 has 34 values, 33 as before"),
        (f"{NAMES}\n{UP}\n{DOWN.replace('10', 'ten')}\n", "line 3: 'ten' is not a number"),
        (f"{NAMES}\n# nothing\n\n", "needed, it has none"),
        (f"{UP.replace(',0,', ';0,')}\n", "columns|numbers"),
    ],
)
def test_a_row_that_is_wrong_is_named_by_its_line(text: str, problem: str) -> None:
    with pytest.raises(DrawingError, match=problem):
        parse_drawing(text.encode(), "a.csv")


def test_drones_of_a_csv_zip_come_in_natural_order() -> None:
    """As file managers show them, whatever the order in which the zip was made."""
    names = ["Drone 10.csv", "drone 2.csv", "Drone 1.csv", "drone 02b.csv", f"drone {'9' * 5000}.csv"]
    rows = "Time_msec,X,Y,Z\n0,0,0,{0}\n1000,0,0,{0},\n"
    show = parse_drawing(zipped({name: rows.format(at) for at, name in enumerate(names)}), "a.zip")
    order = [0, 4, 2, 1, 3]
    assert [name[:9] for name in show.vehicles] == [
        "Drone 1",
        "drone 2",
        "drone 02b",
        "Drone 10",
        "drone 999",
    ]
    assert (-show.home_m[:, 2]).tolist() == [2, 1, 3, 0, 4], order


def wrapped(spelled: str) -> bytes:
    """A compiled show with names as some archivers write them."""
    entries = skyc(
        {"trajectory": {"$ref": "./drones/drone_1/trajectory.json#"}},
        settings={"cues": {"$ref": "./cues.json"}},
    )
    entries["drones/drone_1/trajectory.json"] = HOVER["trajectory"]
    entries["cues.json"] = {"version": 1, "items": [{"time": 3.0, "name": "start"}]}
    return zipped(
        {
            spelled.format(name).replace("/", "\\") if "\\" in spelled else spelled.format(name): entry
            for name, entry in entries.items()
        }
    )


@pytest.mark.parametrize("spelled", ["{}", "./{}", "My Show/{}", "a/b/{}", ".\\{}", "My Show\\{}", "/{}"])
def test_archives_may_have_a_folder_above_or_other_names(spelled: str) -> None:
    show = parse_drawing(wrapped(spelled), "a.skyc")
    assert show.trajectories.at(10.0).position_m[0].tolist() == [0.0, 0.0, -5.0]
    assert [cue.name for cue in show.cues] == ["start"]


def test_what_a_file_manager_adds_is_passed_over() -> None:
    entries: dict[str, Any] = {f"show/{name}": entry for name, entry in skyc(HOVER).items()}
    added = {"__MACOSX/show/._show.json": b"\0", "show/.DS_Store": b"\0", "show/__MACOSX/show.json": b"{"}
    assert len(parse_drawing(zipped(added | entries), "a.skyc")) == 1


def test_two_shows_in_one_archive_are_refused() -> None:
    two = {f"{folder}/{name}": entry for folder in "ab" for name, entry in skyc(HOVER).items()}
    with pytest.raises(DrawingError, match=r"'a/show\.json' and 'b/show\.json': one show\.json is needed"):
        parse_drawing(zipped(two), "a.skyc")
    with pytest.raises(DrawingError, match=r"two entries are called 'show\.json'"):
        parse_drawing(zipped({"show.json": "{}", "./show.json": "{}"}), "a.skyc")


@pytest.mark.parametrize(
    ("folder", "reference"),
    [
        ("Drone #1", "./drones/Drone #1/trajectory.json#"),
        ("Drone #1", "drones/Drone #1/trajectory.json"),
        ("Drone #1", "./drones/Drone%20%231/trajectory.json#"),
        ("Drone #1", ".\\drones\\Drone #1\\trajectory.json#/"),
        ("{0} 50 %", "./drones/{0} 50 %/trajectory.json#"),
        ("100%25", "./drones/100%25/trajectory.json#"),
    ],
)
def test_names_of_entries_may_have_any_signs(folder: str, reference: str) -> None:
    entries = skyc({"trajectory": {"$ref": reference}, "name": folder})
    entries[f"drones/{folder}/trajectory.json"] = HOVER["trajectory"]
    show = parse_drawing(zipped(entries), "a.skyc")
    assert show.vehicles == (folder,)
    assert show.duration_s == 10.0


def test_names_with_any_signs_become_a_show(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Titles, drones and cues are words of the artist; a file's name is the operator's."""
    odd = '{Finale} #1: "100 %" - [a, b] & *c'
    cues = {
        "version": 1,
        "items": [{"time": 2, "name": odd}, {"time": 4, "name": "{}"}, {"time": 6, "name": "#"}],
    }
    high = flight([0, [0, 0, 8]], [10, [0, 0, 9]])
    given, target = tmp_path / "{a} #1.skyc", tmp_path / "night #2 {}.yaml"
    given.write_bytes(zipped(skyc({**high, "name": odd}, settings={"cues": cues}, meta={"title": odd})))
    assert main(["show", "import", str(given), "-o", str(target), "--origin", "-33.85,151.2,20,0"]) == 0
    loaded = load(target)
    assert loaded.show.about == odd
    assert [cue.cue for cue in loaded.show.timeline] == ["drawn", odd, "{}", "#"]
    assert loaded.drawing is not None
    assert loaded.drawing.vehicles == (odd,)
    capsys.readouterr()
    assert main(["show", "place", str(target), "--at", "-3,4,90", "-o", str(target), "--json"]) == 0
    assert load(target).show.about == odd


def lit(*codes: tuple[int, ...], ends_s: tuple[float, ...] = (10.0, 20.0)) -> DrawnShow:
    drones = [
        {**flight([0, [0, 0, 5]], [end_s, [0, 0, 9]]), "lights": light(*code)}
        for code, end_s in zip(codes, ends_s, strict=True)
    ]
    return parse_drawing(zipped(skyc(*drones)), "a.skyc")


RED_30_S = 4, 255, 0, 0, 0x80 | (1500 & 127), 1500 >> 7


def test_lights_go_to_their_own_end() -> None:
    """A light program runs on the show's clock, also when its drone, or every drone, has landed."""
    show = lit((*RED_30_S, 6, 50, 0), (*RED_30_S, 8, 0, 0, 255, 100, 0))
    assert show.lights.colours_at(29.9).tolist() == [RED, RED]
    assert show.lights.colours_at(30.1)[0].tolist() == BLACK
    assert show.lights.at(31.0)[1].tolist() == pytest.approx([127.5, 0, 127.5])
    assert show.lights.colours_at(900.0).tolist() == [BLACK, [0, 0, 255]]
    assert show.lights.end_s == pytest.approx(32.0)


def test_an_endless_loop_goes_on_to_the_end_of_the_show() -> None:
    """Of the drone that ends first as well: 0.5 s white, 0.5 s black."""
    show = lit((12, 0, 7, 25, 6, 25, 13), (7, 1, 0))
    assert [show.lights.colours_at(at_s)[0, 0] for at_s in (9.2, 9.7, 19.2, 19.7)] == [255, 0, 255, 0]


def test_a_very_long_program_is_cut_and_named() -> None:
    """255 times 255 flashes are meant to last for the whole show."""
    code = 12, 255, 12, 255, 7, 1, 6, 1, 13, 13, 0
    show = lit(code, (7, 1, 0))
    assert show.lights.end_s > 20.0
    assert any("not shown: too many loops" in note for note in show.notes)


def test_a_drawing_without_lights_is_white() -> None:
    """As viewers show it; a program without a command is black, there and here."""
    show = parse_drawing(zipped(skyc(HOVER, {**HOVER, "lights": light()})), "a.skyc")
    assert show.lights.colours_at(3.0).tolist() == [WHITE, BLACK]


@pytest.mark.parametrize("suffix", [".skyc", ".zip"])
def test_lights_and_positions_come_back_from_an_export(suffix: str, tmp_path: Path) -> None:
    """To the end of the longest light program, which comes after that of the trajectories."""
    made = lit(
        (*RED_30_S, 8, 0, 0, 255, 100, 6, 20, 0), (12, 8, 7, 25, 6, 25, 10, 40, 13, 4, 9, 8, 7, 100, 0)
    )
    write_drawing(made, tmp_path / f"a{suffix}")
    read = parse_drawing((tmp_path / f"a{suffix}").read_bytes(), f"a{suffix}")
    assert read.lights.end_s == pytest.approx(made.lights.end_s, abs=0.03)
    for at_s in np.arange(0.003, made.lights.end_s + 2.0, 0.05).tolist():
        assert np.abs(read.lights.at(at_s) - made.lights.at(at_s)).max() <= 1.0, at_s
        apart_m = read.trajectories.at(at_s).position_m - made.trajectories.at(at_s).position_m
        assert np.linalg.norm(apart_m, axis=1).max() <= 0.01, at_s


def test_corners_come_back_from_a_table(tmp_path: Path) -> None:
    """Straight lines between points, as many programs draw them: at 3 m/s, with stops at once."""
    points = [0.33, [0, 0, 0]], [5.37, [0, 0, 9]], [9.01, [11, 0, 9]], [9.5, [11, 0, 9]], [15.11, [0, 5, 9]]
    made = parse_drawing(zipped(skyc(flight(*map(list, points)), HOVER)), "a.skyc")
    write_drawing(made, tmp_path / "a.zip")
    read = parse_drawing((tmp_path / "a.zip").read_bytes(), "a.zip")
    for at_s in np.arange(0.0, 17.0, 0.007).tolist():
        apart_m = read.trajectories.at(at_s).position_m - made.trajectories.at(at_s).position_m
        assert np.linalg.norm(apart_m, axis=1).max() <= 0.01, at_s


def test_vviz_has_the_lights_to_their_end(tmp_path: Path) -> None:
    write_drawing(lit((*RED_30_S, 6, 50, 0), (7, 1, 0)), tmp_path / "a.vviz")
    first = json.loads((tmp_path / "a.vviz").read_text())["performances"][0]
    actions = first["payloadDescription"][0]["payloadActions"]
    assert sum(action.get("frames", 0) for action in actions) == 31 * 20
    assert (actions[0]["r"], actions[-1]["r"]) == (255, 0)


def test_what_nothing_reads_is_named() -> None:
    """Files of skyc_utils have parameters and yaw in a fourth coordinate; others have what is new."""
    points: list[Any] = [[0, [0, 0, 1, 0], []], [10, [4, 0, 1, 90], [[0, 4, 1, 30], [4, 4, 1, 60]]]]
    drone = {
        "trajectory": {"version": 1, "points": points, "type": "COMPRESSED", "K": [1]},
        "parameters": [[1, "a", 2]],
    }
    show = parse_drawing(
        zipped(
            skyc(
                drone,
                drone,
                media={},
                settings={"geofence": {"version": 1, "action": "land", "polygons": []}},
                environment={"type": "indoor", "cameras": [{"name": "front"}]},
                meta={"id": "x.py", "timestampOffset": 12.5},
            )
        ),
        "a.skyc",
    )
    for named in (
        "'K' of a trajectory",
        "'parameters' of a drone's settings",
        "'action' of geofence",
        "'cameras'",
        "'timestampOffset'",
    ):
        assert any(named in note for note in show.notes), (named, show.notes)
    assert any("fourth coordinate" in note and "(2 drones)" in note for note in show.notes)
    assert not any("music" in note or "'type'" in note for note in show.notes)


def test_a_file_with_many_keys_does_not_fill_the_page() -> None:
    show = parse_drawing(zipped(skyc({**HOVER, **{f"key{at}": 1 for at in range(500)}})), "a.skyc")
    assert len(show.notes) <= 21
    assert any("further keys" in note for note in show.notes)


def climbing(rate_m_s: float, top_m: float, cues: Mapping[str, float] | None = None) -> DrawnShow:
    """Two drones that climb, stay for 20 s and sink."""
    up_s = top_m / rate_m_s
    times_s = 0.0, up_s, up_s + 20.0, 2.0 * up_s + 20.0
    drones = [
        flight(*([at_s, [x_m, 0, z_m]] for at_s, z_m in zip(times_s, (0, top_m, top_m, 0), strict=True)))
        for x_m in (0, 6)
    ]
    items = [{"name": name, "time": at_s} for name, at_s in (cues or {}).items()]
    return parse_drawing(zipped(skyc(*drones, settings={"cues": {"version": 1, "items": items}})), "a.skyc")


@pytest.mark.parametrize("rate_m_s", [0.05, 0.5, 2.0])
@pytest.mark.parametrize(("takeoff_m", "least_m"), [(5.0, 3.0), (8.0, 6.0)])
def test_a_part_begins_where_the_take_off_hands_over(
    rate_m_s: float, takeoff_m: float, least_m: float
) -> None:
    """Not on the edge of the fence that the import writes, however slowly the drawing climbs."""
    fence = {"height_min_m": least_m, "height_max_m": 100, "distance_max_m": 300}
    rules = ServiceRules.model_validate({"takeoff_height_m": takeoff_m, "fence": fence})
    drawing = climbing(rate_m_s, 12.0)
    from_s, to_s = show_file(drawing, "a.skyc", "0" * 64, origin=PLACE, rules=rules).flown_s
    for at_s in (from_s, to_s):
        heights_m = -drawing.trajectories.at(at_s).position_m[:, 2]
        assert takeoff_m - 0.02 <= heights_m.min() <= takeoff_m + 0.25 * rate_m_s + 1e-6


def test_a_drawing_lower_than_the_take_off_is_flown_near_its_top() -> None:
    from_s, to_s = show_file(climbing(0.5, 4.0), "a.skyc", "0" * 64, origin=PLACE).flown_s
    assert (from_s, to_s) == pytest.approx((7.25, 28.75), abs=0.26)


def test_a_dip_in_the_middle_does_not_end_the_show() -> None:
    """Down to 3.5 m and up again: above the fence's least height all the time."""
    drone = flight([0, [0, 0, 0]], [10, [0, 0, 10]], [20, [0, 0, 3.5]], [30, [0, 0, 10]], [40, [0, 0, 0]])
    drawing = parse_drawing(zipped(skyc(drone)), "a.skyc")
    assert show_file(drawing, "a.skyc", "0" * 64, origin=PLACE).flown_s == pytest.approx(
        (5.0, 35.0), abs=0.26
    )


def test_a_drawing_that_is_too_low_says_when_and_which_vehicle() -> None:
    with pytest.raises(
        ConfigError, match=r"never 3 m or higher together.*at 2\.00 s .*, drone 1 is at 1\.00 m"
    ):
        show_file(climbing(0.5, 1.0), "a.skyc", "0" * 64, origin=PLACE)


def test_cues_that_are_not_flown_are_named() -> None:
    cues = {
        "doors": 0.0,
        "take-off": 5.0,
        "wall": 30.0,
        "also wall": 30.0,
        "bow": 60.0,
        "landing": 75.0,
        "party": 500.0,
    }
    written = show_file(climbing(0.5, 12.0, cues), "a.skyc", "0" * 64, origin=PLACE)
    assert written.flown_s == pytest.approx((10.0, 58.0), abs=0.3)
    (note,) = written.notes
    for name in ("doors", "also wall", "bow", "landing", "party"):
        assert f"'{name}' at" in note
    assert "'wall'" not in note.replace("'also wall'", "")
    assert "'take-off'" not in note


def test_binary_samples_of_one_point_are_a_place() -> None:
    """A trajectory of a single sample stays there."""
    points = b64encode(np.array([[0.0, 1, 2, 5]], "<f4").tobytes()).decode()
    show = parse_drawing(zipped(skyc({"trajectory": {"version": 2, "points": points}}, HOVER)), "a.skyc")
    assert show.trajectories.at(7.0).position_m[0].tolist() == [1.0, -2.0, -5.0]


def test_lights_go_on_while_the_vehicles_return(tmp_path: Path) -> None:
    """The show ends at 10 s of the drawing: red until 30 s, then black, on the way home."""
    drone = {**flight([0, [0, 0, 5]], [10, [0, 0, 9]]), "lights": light(*RED_30_S, 6, 50, 0)}
    (tmp_path / "in.skyc").write_bytes(zipped(skyc(drone)))
    target = tmp_path / "a.yaml"
    assert main(["show", "import", str(tmp_path / "in.skyc"), "-o", str(target), "--origin", "-1,2,3,4"]) == 0
    run = ShowRun("a", load(target).timeline, started=True, parts={"d1": 0})
    assert run.timeline.duration_s == 10.0

    def colour(now_s: float) -> list[int]:
        return list(run.colours(["d1"], now_s)[0][0].tolist())

    run.follow(ShowPhase.RUNNING, 100.0)
    assert colour(109.0) == RED
    run.follow(ShowPhase.RETURNING, 110.05)
    assert [colour(now_s) for now_s in (111.0, 129.0, 131.0, 999.0)] == [RED, RED, BLACK, BLACK]
    run.follow(ShowPhase.LANDED, 140.0)
    assert colour(141.0) == RED  # its beginning: vehicles on the ground show their batteries


def test_lights_of_a_show_that_is_stopped_early_stay(tmp_path: Path) -> None:
    drone = {**flight([0, [0, 0, 5]], [60, [0, 0, 9]]), "lights": light(*RED_30_S, 6, 50, 0)}
    (tmp_path / "in.skyc").write_bytes(zipped(skyc(drone)))
    target = tmp_path / "a.yaml"
    assert main(["show", "import", str(tmp_path / "in.skyc"), "-o", str(target), "--origin", "-1,2,3,4"]) == 0
    run = ShowRun("a", load(target).timeline, started=True, parts={"d1": 0})
    run.follow(ShowPhase.RUNNING, 100.0)
    run.follow(ShowPhase.RETURNING, 110.0)
    assert run.colours(["d1"], 180.0)[0][0].tolist() == RED


@pytest.mark.parametrize("made", GENERATORS)
@pytest.mark.parametrize("folder", ["", "show/", ".\\"])
def test_shows_of_five_generators_become_shows(
    made: Callable[[], dict[str, Any]], folder: str, tmp_path: Path
) -> None:
    """Imported, without a flaw in what is drawn, and the same after an export."""
    given, target = tmp_path / "in.skyc", tmp_path / "a.yaml"
    given.write_bytes(zipped({f"{folder}{name}": entry for name, entry in made().items()}))
    assert main(["show", "import", str(given), "-o", str(target), "--origin-else", "-33.8,151.2,20,0"]) == 0
    loaded = load(target)
    assert examine(loaded.timeline)[1] == []
    assert loaded.drawing is not None
    write_drawing(loaded.drawing, tmp_path / "out.skyc")
    again = parse_drawing((tmp_path / "out.skyc").read_bytes(), "out.skyc")
    for at_s in np.arange(0.0, loaded.drawing.duration_s + 3.0, 0.31).tolist():
        apart_m = again.trajectories.at(at_s).position_m - loaded.drawing.trajectories.at(at_s).position_m
        assert np.linalg.norm(apart_m, axis=1).max() <= 0.01
        assert np.abs(again.lights.at(at_s) - loaded.drawing.lights.at(at_s)).max() <= 1.0


SAMPLED = "Time_msec,X,Y,Z\n0,0,0,6\n5000,1,0,9\n12346.7,2,0,6\n"


@pytest.mark.parametrize(
    ("file", "data"),
    [
        ("a.csv", f"{NAMES}\r{UP}\r{DOWN}\r".encode()),
        ("a.skyc", zipped({"a.csv": SAMPLED})),
        ("a.zip", zipped(skyc(flight([0, [0, 0, 6]], [12.3456789, [0, 0, 9]])))),
        ("a.zip", zipped({"a.csv": SAMPLED.replace("\n", "\r")})),
    ],
)
def test_content_counts_not_the_suffix_nor_the_line_ends(file: str, data: bytes, tmp_path: Path) -> None:
    """And a show ends within its drawing, whatever the drawing's last time."""
    (tmp_path / file).write_bytes(data)
    target = tmp_path / "b.yaml"
    assert main(["show", "import", str(tmp_path / file), "-o", str(target), "--origin", "-1,2,3,4"]) == 0
    drawing = load(target).drawing
    assert drawing is not None
    assert 12.0 <= drawing.duration_s < 12.4


@pytest.mark.parametrize(
    ("file", "data", "words"),
    [
        ("a.csv", b"", "a.csv: the file is empty"),
        ("a.csv", zipped({"a.csv": SAMPLED}), "a.csv: a zip archive: give it the suffix .skyc or .zip"),
        ("a.csv", NAMES.encode("utf-16"), "byte 0 (0xff) is not UTF-8: save the file as CSV in UTF-8"),
        ("a.csv", b"1,2,3\n", "3 columns: 4 (time in ms, x, y, z in m) or 7 (time in ms, x, y, z in m, red,"),
        (
            "a.csv",
            UP.replace(",", ";").encode(),
            "rows of numbers with commas between them are needed: line 1",
        ),
        (
            "a.zip",
            zipped({"a.csv": "t,x,y,z\n0,0,0,5\n60,0,0,5\n"}),
            "row 2: 60, 0, 0, 5: times in milliseconds",
        ),
        (
            "a.zip",
            zipped({"a.csv": SAMPLED.replace("Time_msec", "frame")}),
            "'frame': milliseconds are needed",
        ),
        ("a.skyc", zipped(skyc(flight([0, [0, 0, 9]]))), "the drawing lasts 0 s, and its show"),
        (
            "a.skyc",
            zipped(skyc(HOVER, meta={"segments": {"show": [200, 300]}})),
            "lasts 10 s, and its show (meta.segments) begins at 200 s: nothing of it can be flown",
        ),
    ],
)
def test_what_is_wrong_with_a_file_is_said(
    file: str, data: bytes, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / file).write_bytes(data)
    arguments = [str(tmp_path / file), "-o", str(tmp_path / "b.yaml"), "--origin", "-1,2,3,4"]
    assert main(["show", "import", *arguments]) == 2
    assert words in capsys.readouterr().err
