"""The flight report: violations are found with vehicle and time, files that are no record are refused."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs.cli.main import main
from gcs.config import schema as configuration
from gcs.control import ControlSettings
from gcs.model.frames import ShowFrame
from gcs.model.lifecycle import Phase
from gcs.model.state import Array
from gcs.recording import mcap_layout as layout
from gcs.recording.flight_report import make_flight_report, nearest_approaches
from gcs.recording.mcap_reader import FlightData, Standard
from gcs.recording.mcap_writer import FlightFile
from gcs.recording.trajectories import estimated, true
from gcs.safety.floor import Floor
from tests.support.record_samples import ids_of, sample

CONFIG = configuration.load(configuration.find("demo"))
FRAME = CONFIG.frame
STEP_S = 0.05
Path3 = Callable[[Array], Array]  # (k,) times to (k, 3) places, show frame


def stands(x_m: float, y_m: float, z_m: float) -> Path3:
    return lambda time_s: np.tile([x_m, y_m, z_m], (len(time_s), 1))


def moves(x_m: float, y_m: float, z_m: float, velocity: tuple[float, float, float]) -> Path3:
    return lambda time_s: np.array([x_m, y_m, z_m]) + np.outer(time_s, velocity)


def truth(file: Path, *paths: Path3, seconds: float = 4.0, frame: ShowFrame = FRAME, first: int = 1) -> Path:
    time_s = np.arange(0.0, seconds, STEP_S)
    places = np.stack([path(time_s) for path in paths], axis=1)
    velocity_m_s = frame.into_ned(np.gradient(places, STEP_S, axis=0).reshape(-1, 3)).reshape(places.shape)
    lines = []
    for at, place_m in enumerate(places):
        latitude, longitude, altitude = frame.geodetic(place_m)
        vehicles = [
            {
                "vehicle": row + first,
                "latitude_deg": latitude[row],
                "longitude_deg": longitude[row],
                "altitude_amsl_m": altitude[row],
                "velocity_north_m_s": velocity_m_s[at, row, 0],
                "velocity_east_m_s": velocity_m_s[at, row, 1],
                "velocity_down_m_s": velocity_m_s[at, row, 2],
                "armed": True,
                "landed": False,
                "mode": "OFFBOARD",
            }
            for row in range(len(paths))
        ]
        lines.append(json.dumps({"time_s": 100.0 + time_s[at], "vehicles": vehicles}))
    file.write_text("\n".join(lines) + "\n")
    return file


def judged(*arguments: object) -> tuple[int, dict[str, Any]]:
    report = Path(str(arguments[0])).parent / "report.json"
    code = main(["report", *map(str, arguments), "--report", str(report)])
    return code, json.loads(report.read_text())


def check(report: dict[str, Any], name: str) -> dict[str, Any]:
    (found,) = [each for each in report["checks"] if each["name"].startswith(name)]
    return dict(found)


def test_flight_that_kept_every_limit_passes(tmp_path: Path) -> None:
    file = truth(tmp_path / "truth-1.jsonl", stands(0, 0, -20), moves(10, 0, -20, (1.0, 0.0, -0.5)))
    code, report = judged(file, "--config", "demo")
    assert (code, report["verdict"], report["based_on"], report["vehicles"]) == (
        0,
        "kept",
        "true positions",
        2,
    )
    assert check(report, "separation")["worst"] == pytest.approx(5.0, abs=0.01)  # 10 m over a floor of 2
    assert check(report, "speed sideways")["worst"] == pytest.approx(1.0, abs=0.02)


def test_approach_between_two_samples_is_found(tmp_path: Path) -> None:
    """At 8 m/s each, 0.4 m a sample: they are 0.4 m apart in both samples, and touch between them."""
    paths = moves(-9.8, 0, -20, (8.0, 0.0, 0.0)), moves(9.8 + 0.4 / 2, 0, -20, (-8.0, 0.0, 0.0))
    code, report = judged(truth(tmp_path / "truth-1.jsonl", *paths), "--config", "demo")
    assert (code, report["verdict"]) == (1, "broken")
    (pair,) = report["nearest_pairs"]
    assert (pair["vehicles"], pair["distance_m"]) == (["1", "2"], pytest.approx(0.0, abs=0.01))
    assert pair["at_s"] == pytest.approx(1.2, abs=0.1)
    assert not check(report, "separation")["kept"]


def test_the_floor_is_taller_than_wide(tmp_path: Path) -> None:
    over = truth(tmp_path / "a.jsonl", stands(0, 0, -20), stands(0, 0, -22.5))
    beside = truth(tmp_path / "b.jsonl", stands(0, 0, -20), stands(2.5, 0, -20))
    assert judged(over, "--config", "demo")[0] == 1
    assert judged(beside, "--config", "demo")[0] == 0


def test_low_over_their_pads_vehicles_may_be_close(tmp_path: Path) -> None:
    code, report = judged(
        truth(tmp_path / "a.jsonl", stands(0, 0, -1), stands(1.5, 0, -1)), "--config", "demo"
    )
    assert (code, check(report, "separation")["worst"]) == (0, None)


def test_limit_passed_within_its_tolerance_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = truth(tmp_path / "truth-1.jsonl", moves(0, 0, -20, (8.5, 0, 0)))
    code, report = judged(file, "--config", "demo")
    found = check(report, "speed sideways")
    assert (code, found["kept"], found["limit"], found["tolerated"]) == (0, True, 8.0, 9.1)
    assert found["worst"] == pytest.approx(8.5, abs=0.02)
    assert check(report, "greatest distance")["tolerated"] == check(report, "greatest distance")["limit"]
    capsys.readouterr()
    main(["report", str(file), "--config", "demo"])
    reported = capsys.readouterr().out
    assert "limit 8 m/s (kept up to 9.1)" in reported
    assert "limit 300 m " in reported


@pytest.mark.parametrize(
    ("path", "name"),
    [
        (stands(400, 0, -20), "greatest distance"),
        (stands(0, 0, -150), "greatest height"),
        (moves(0, 0, -20, (9.5, 0, 0)), "speed sideways"),
        (moves(0, 0, -20, (0, 0, -3.5)), "speed up"),
        (moves(0, 0, -40, (0, 0, 2.5)), "speed down"),
        (lambda s: np.stack([6.0 * np.sin(1.1 * s), 0 * s, -20 + 0 * s], axis=1), "acceleration"),
    ],
)
def test_violation_is_named_with_vehicle_and_time(tmp_path: Path, path: Path3, name: str) -> None:
    file = truth(tmp_path / "truth-1.jsonl", stands(0, 50, -20), path)
    code, report = judged(file, "--config", "demo")
    broken = [each["name"] for each in report["checks"] if each["kept"] is False]
    assert (code, broken) == (1, [name])
    assert check(report, name)["vehicle"] == "2"


def test_several_truth_files_are_one_flight_with_a_heading(tmp_path: Path) -> None:
    raw = CONFIG.model_dump(mode="json")
    raw["show_frame"]["heading_deg"] = 70.0
    turned = configuration.Config.model_validate(raw)
    truth(tmp_path / "truth-1.jsonl", stands(0, 0, -20), frame=turned.frame)
    truth(tmp_path / "truth-2.jsonl", moves(6, 0, -20, (1.0, 0.0, 0.0)), frame=turned.frame, first=2)
    trajectories = true(sorted(tmp_path.glob("truth-*.jsonl")), turned.frame, None, ())
    assert trajectories.ids == ("1", "2")
    np.testing.assert_allclose(trajectories.position_m[0, 1], [6.0, 0.0, -20.0], atol=2e-3)
    np.testing.assert_allclose(trajectories.velocity_m_s[10, 1], [1.0, 0.0, 0.0], atol=1e-3)


def flight(
    folder: Path,
    *,
    apart_m: float,
    uncertainty_m: float = 0.35,
    count: int = 40,
    controls: tuple[ControlSettings, ...] = (CONFIG.control,),
) -> Path:
    about = layout.about("s1", CONFIG.model_dump_json(), dict.fromkeys(ids_of(2), (1, "a")))
    file = FlightFile(folder, about)
    file.open()
    for tick in range(count):
        place_m = np.array([[0.0, 0.0, -20.0], [apart_m, 0.0, -20.0]])
        file.add(
            sample(
                time_s=100.0 + tick * STEP_S,
                position_m=place_m,
                phases=[Phase.FORMATION, Phase.FORMATION],
                uncertainty_m=np.full(2, uncertainty_m),
                control=controls[tick * len(controls) // count],
            )
        )
    file.close()
    return folder / "flight.mcap"


def test_limits_that_change_in_flight_are_noted(tmp_path: Path) -> None:
    """A value is then not the greatest of the flight, but the one nearest to its limit."""
    safety = CONFIG.control.safety
    fence = safety.fence.model_copy(update={"height_max_m": 22.0})
    safety = safety.model_copy(update={"fence": fence})
    lower = CONFIG.control.model_copy(update={"safety": safety})
    _, report = judged(flight(tmp_path, apart_m=5.0, controls=(CONFIG.control, lower)))
    assert check(report, "greatest height")["limit"] == 22.0
    assert [text for text in report["remarks"] if "the one nearest to its limit then" in text]
    _, report = judged(flight(tmp_path / "same", apart_m=5.0))
    assert report["remarks"] == []


def test_estimates_are_judged_with_their_uncertainty(tmp_path: Path) -> None:
    code, report = judged(flight(tmp_path, apart_m=3.0))
    assert (code, report["based_on"]) == (0, "estimated positions")
    assert "up to 0.35 m sideways" in str(report["uncertainty"])
    (pair,) = report["nearest_pairs"]
    assert (pair["vehicles"], pair["floor_ratio"]) == (["d1", "d2"], pytest.approx(1.5, abs=0.01))
    assert pair["floor_ratio_if_off"] == pytest.approx(1.5 - 6.0 * hypot(0.35, 0.35) / 1.5, abs=0.01)
    assert check(report, "setpoint sideways")["worst"] == pytest.approx(1.0)
    assert judged(flight(tmp_path / "near", apart_m=1.9))[0] == 1


def test_truth_beside_a_record_has_precedence_and_its_names(tmp_path: Path) -> None:
    flight(tmp_path, apart_m=30.0)
    truth(tmp_path / "truth-1.jsonl", stands(0, 0, -20), stands(1, 0, -20))
    code, report = judged(tmp_path / "flight.mcap", tmp_path / "truth-1.jsonl")
    assert (code, report["based_on"]) == (1, "true positions")
    assert report["nearest_pairs"][0]["vehicles"] == ["d1", "d2"]
    code, report = judged(tmp_path / "flight.mcap", tmp_path / "truth-1.jsonl", "--positions", "estimated")
    assert (code, report["based_on"]) == (0, "estimated positions")


def test_truncated_file_is_judged_up_to_its_cut(tmp_path: Path) -> None:
    whole = flight(tmp_path, apart_m=10.0).read_bytes()
    (tmp_path / "flight.mcap").write_bytes(whole[:-100])
    code, report = judged(tmp_path / "flight.mcap")
    assert (code, report["verdict"]) == (3, "incomplete")
    assert "cut off or damaged from byte" in str(report["missing"])
    text = truth(tmp_path / "truth-1.jsonl", stands(0, 0, -20), stands(9, 0, -20)).read_text()
    (tmp_path / "truth-1.jsonl").write_text(text[:-40])
    code, report = judged(tmp_path / "truth-1.jsonl", "--config", "demo")
    assert (code, report["verdict"]) == (3, "incomplete")
    assert "its last line is cut off" in str(report["missing"])


def test_report_page_is_self_contained(tmp_path: Path) -> None:
    file = flight(tmp_path, apart_m=1.9)
    assert main(["report", str(file), "--html", str(tmp_path / "page.html")]) == 1
    text = (tmp_path / "page.html").read_text()
    assert "estimated positions" in text
    assert "<svg" in text
    assert text.count("Nearest pairs") == 1
    assert "src=" not in text
    assert "http://" not in text.replace("http://www.w3.org", "").replace("http://purl.org", "").replace(
        "http://creativecommons.org", ""
    )


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("a.mcap", b"no mcap", "not flight data of this program"),
        ("a.jsonl", b"", "no true states were written"),
        ("a.jsonl", b"\xff\xfe\x00", "not text"),
        ("a.jsonl", b"[1, 2]\n[3]\n", "line 1: not a sample of true states"),
        ("a.jsonl", b"[" * 9999 + b"\n", "line 1: not a sample of true states"),
        ("a.jsonl", b'{"time_s": 1.0, "vehicles": [{"vehicle": 1}]}\n', "line 1: not a sample"),
        ("a.jsonl", b'{"time_s": 1.0, "vehicles": []}\n{"time_s": 1.0, "vehicles": []}\n', "do not increase"),
    ],
)
def test_file_that_is_no_record_is_refused_with_its_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, content: bytes, reason: str
) -> None:
    (tmp_path / name).write_bytes(content)
    assert main(["report", str(tmp_path / name), "--config", "demo"]) == 2
    reported = capsys.readouterr().err
    assert name in reported
    assert reason in reported


def test_what_cannot_be_judged_names_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = truth(tmp_path / "truth-1.jsonl", stands(0, 0, -20))
    assert main(["report", str(file)]) == 2
    assert "give flight.mcap too, or --config FILE" in capsys.readouterr().err
    assert main(["report", str(tmp_path / "absent.mcap")]) == 2
    assert "there is no such file" in capsys.readouterr().err
    (tmp_path / "empty").mkdir()
    assert main(["report", str(tmp_path / "empty")]) == 2
    assert "there is no flight*.mcap" in capsys.readouterr().err


def test_nearest_pairs_are_those_of_all_pairs(tmp_path: Path) -> None:
    rng, n = np.random.default_rng(4), 40
    starts_m = np.hstack([rng.uniform(-40, 40, (n, 3)) - [0, 0, 60], rng.uniform(-3, 3, (n, 3))])
    paths = [moves(x, y, z, (u, v, w)) for x, y, z, u, v, w in starts_m.tolist()]
    trajectories = true([truth(tmp_path / "a.jsonl", *paths, seconds=2.0)], FRAME, None, ())
    floor = Floor()
    pairs, least_m = nearest_approaches(trajectories, floor)
    away_m = np.linalg.norm(trajectories.position_m[:, :, None] - trajectories.position_m[:, None], axis=-1)
    away_m[:, np.tri(n, dtype=bool)] = np.inf
    np.testing.assert_allclose(least_m, away_m.min(axis=(1, 2)), atol=0.35)  # between samples even less
    assert (least_m <= away_m.min(axis=(1, 2)) + 1e-4).all()
    i, j = pairs.nearest(1)[0]
    scaled = np.linalg.norm(
        (trajectories.position_m[:, i] - trajectories.position_m[:, j]) * floor.scale, axis=-1
    ).min()
    assert pairs.ratio[i, j] <= scaled / floor.horizontal_m + 1e-5


def sped_up(folder: Path, *, late_s: float) -> Path:
    """A vehicle speeds up by 2 m/s^2, of 3; from 2 s on its positions arrive every `late_s` only."""
    file = FlightFile(
        folder, layout.about("s1", CONFIG.model_dump_json(), dict.fromkeys(ids_of(2), (1, "a")))
    )
    file.open()
    for tick in range(80):
        now_s = tick * STEP_S
        old_s = 0.05 if now_s < 2.0 else 0.05 + (now_s - 2.0) % late_s
        velocity_m_s = np.array([[0.0, 0.0, 0.0], [2.0 * (now_s - old_s), 0.0, 0.0]])
        place_m = np.array([[0.0, 0.0, -20.0], [10.0 + now_s**2, 0.0, -20.0]])
        file.add(
            sample(
                time_s=100.0 + now_s,
                number=tick,
                position_m=place_m,
                velocity_m_s=velocity_m_s,
                setpoint_m_s=np.ones((2, 3)),
                position_age_s=np.array([0.05, old_s]),
            )
        )
    file.close()
    return folder / "flight.mcap"


def test_late_positions_are_no_acceleration(tmp_path: Path) -> None:
    for name, late_s in (("steady", 0.05), ("late", 0.8)):
        _, report = judged(sped_up(tmp_path / name, late_s=late_s))
        assert check(report, "acceleration")["kept"]
        assert check(report, "acceleration")["worst"] == pytest.approx(2.0, abs=0.1)
        remarks = [text for text in report["remarks"] if "acceleration is not judged" in text]
        assert len(remarks) == (name == "late")
        assert not remarks or re.match("[1-9][0-9]* of 160 positions in flight are older", remarks[0])


def test_broken_limits_come_first(tmp_path: Path) -> None:
    file = truth(tmp_path / "truth-1.jsonl", stands(0, 50, -20), moves(0, 0, -20, (9.5, 0, 0)))
    _, report = judged(file, "--config", "demo")
    assert [each["kept"] for each in report["checks"]][:2] == [False, True]
    assert report["checks"][0]["name"] == "speed sideways"


def test_progress_covers_the_whole_flight(tmp_path: Path) -> None:
    data = FlightData(flight(tmp_path, apart_m=5.0, count=4000))
    read: list[float] = []
    trajectories = estimated(data, read.append)
    judged_so_far: list[float] = []
    standard = Standard.of(data.about.config, "it")
    make_flight_report(trajectories, standard, on_progress=judged_so_far.append)
    for shares in (read, judged_so_far):
        assert shares == sorted(shares)
        assert shares[-1] <= 1.0
    assert read[0] < 0.1
    assert read[-1] > 0.8
    assert judged_so_far[-1] == 1.0


def test_flight_judged_in_pieces_equals_one_piece(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = truth(tmp_path / "truth-1.jsonl", moves(-6, 0, -9, (3, 0, 0)), moves(6, 1, -9, (-3, 0, 0)))
    whole = judged(file, "--config", "demo")
    monkeypatch.setattr("gcs.recording.flight_report.PAIRS_AT_ONCE", 28)
    assert judged(file, "--config", "demo") == whole


@pytest.mark.alternates(0)
@pytest.mark.parametrize(("options", "is_shown"), [((), True), (("--json",), False)])
def test_terminal_shows_percent_on_standard_error_not_with_json(
    tmp_path: Path, options: tuple[str, ...], is_shown: bool
) -> None:
    file = truth(tmp_path / "truth-1.jsonl", stands(0, 0, -9), stands(9, 0, -9), seconds=60.0)
    ours, theirs = os.openpty()
    command = [sys.executable, "-m", "gcs", "report", str(file), "--config", "demo", *options]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=theirs, env=os.environ | {"TERM": "xterm"}
    ) as process:
        os.close(theirs)
        shown = b""
        try:
            while piece := os.read(ours, 4096):
                shown += piece
        except OSError:  # the other end is closed: all is read
            pass
        out, _ = process.communicate(timeout=60)
    os.close(ours)
    assert (b"%" in shown) == is_shown
    assert b"judging" not in out
    if not is_shown:
        assert shown == b""
        assert json.loads(out)["verdict"]


def site_config(folder: Path) -> Path:
    """The demo's configuration, with an area of the fence and controlled ground."""
    text = configuration.find("demo").read_text()
    ring = "[[-64, -64], [64, -64], [64, 64], [-64, 64]]"
    within = "[[-40, -40], [40, -40], [40, 40], [-40, 40]]"
    fence = f"fence: {{areas: [{{corners_m: {within}}}], controlled_ground: {{corners_m: {ring}}}}}"
    assert "control:" not in text
    (folder / "site.yaml").write_text(f"{text}\ncontrol: {{safety: {{{fence}}}}}\n")
    return folder / "site.yaml"


@pytest.mark.parametrize(
    ("velocity", "code", "contacts", "beyond_area"),
    [((1.0, 0.0, 0.0), 0, 0, False), ((4.0, 0.0, 0.0), 1, 0, True), ((8.0, 0.0, 0.0), 1, 1, True)],
)
def test_contacts_of_the_controlled_ground_are_counted(
    tmp_path: Path, velocity: tuple[float, float, float], code: int, contacts: int, beyond_area: bool
) -> None:
    """At 1, 4 and 8 m/s for 4 s from 27 m before the area's edge, and 30 m high."""
    paths = moves(27.0, 0, -30, velocity), stands(0, 0, -30)
    file = truth(tmp_path / "truth-1.jsonl", *paths)
    result, report = judged(file, "--config", site_config(tmp_path))
    assert result == code
    assert report["ground"]["contacts"] == contacts
    assert check(report, "beyond an area")["kept"] is not beyond_area
    assert check(report, "impact beyond controlled ground")["kept"] is not bool(contacts)
    assert report["ground"]["vehicle"] == "1"
    assert report["ground"]["energy_max_j"] > 100.0


def test_a_flight_without_a_site_has_no_ground(tmp_path: Path) -> None:
    _, report = judged(truth(tmp_path / "truth-1.jsonl", stands(0, 0, -20)), "--config", "demo")
    assert report["ground"] is None
    assert not any("area" in each["name"] or "ground" in each["name"] for each in report["checks"])
