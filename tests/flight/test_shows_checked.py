"""`gcs show` as its users call it: shows flown in virtual time."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs.cli import main
from gcs.shows import LoadedShow, load, shipped
from gcs.shows.service_rules import ServiceRules
from gcs.simulation.rehearsal import Rehearsal, rehearse
from gcs.simulation.scenario import Adversity
from tests.support.written_show import TEXT

_rehearsed: dict[tuple[str, int], Rehearsal] = {}


@pytest.fixture(autouse=True)
def _rehearsed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The command rehearses a show of the same text and seed once for all tests."""

    def once(
        loaded: LoadedShow,
        seed: int,
        on_progress: Callable[[float], None],
        adversity: Adversity | None = None,
        wind_m_s: tuple[float, float] = (0.0, 0.0),
        rules: ServiceRules | None = None,
    ) -> Rehearsal:
        key = loaded.show.digest, seed
        if key not in _rehearsed:
            _rehearsed[key] = rehearse(loaded, seed, on_progress, adversity, wind_m_s, rules)
        return _rehearsed[key]

    monkeypatch.setattr("gcs.cli.simulate.rehearse", once)


BROKEN = Path(__file__).parents[1] / "data" / "shows"

FLOWN = {
    "battery-too-small": (7, None, "s in the air and a reserve of 25% need"),
    "orbit-never-reached": (17, "change", "the formation never reaches its orbit or target"),
    "tower-in-the-sphere": (19, "change", "obstacle tower would stand on"),
}


def checked(capsys: pytest.CaptureFixture[str], file: Path) -> tuple[int, dict[str, Any]]:
    code = main(["show", "check", str(file), "--json"])
    return code, json.loads(capsys.readouterr().out)


@pytest.mark.soak
@pytest.mark.parametrize("path", shipped(), ids=lambda path: path.stem)
def test_a_shipped_show_is_good_to_fly(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, verdict = checked(capsys, path)
    assert (code, verdict["good"], verdict["problems"]) == (0, True, [])
    assert verdict["pairs_below_floor"] == 0
    assert verdict["separation_min_m"] >= verdict["floor_m"]
    assert verdict["fence_distance_margin_m"] > 0.0
    assert verdict["fence_height_margin_m"] > 0.0
    assert verdict["battery_need"] < 1.0
    formed = [cue for cue in verdict["cues"] if cue["radius_error_m"] is not None]  # not drawn
    assert max((cue["center_off_m"] for cue in formed), default=0.0) < 1.0
    assert max((cue["radius_error_m"] for cue in formed), default=0.0) < 2.0
    assert verdict["hash"] == load(path).show.digest
    sideways_m = [pair["sideways_m"] for pair in verdict["columns"]]
    assert len(sideways_m) == min(verdict["vertical_overlaps"], 50)
    assert sideways_m == sorted(sideways_m)
    cues = {cue["cue"].split(" (")[0] for cue in verdict["cues"]}
    assert all(pair["upper"] != pair["lower"] and pair["cue"] in cues for pair in verdict["columns"])


@pytest.mark.soak
def test_check_progress_covers_the_whole_flight() -> None:
    shares: list[float] = []
    flight = rehearse(load(BROKEN / "orbit-never-reached.yaml"), 1, shares.append)
    assert shares == sorted(shares)
    assert shares[0] < 0.05
    assert 0.9 < shares[-1] <= 1.0
    assert len(shares) > flight.time_s / 2
    assert max(np.diff(shares)) < 0.2


@pytest.mark.soak
@pytest.mark.parametrize("name", FLOWN)
def test_problem_found_in_flight_is_reported_with_line_and_cue(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, verdict = checked(capsys, BROKEN / f"{name}.yaml")
    line, cue, words = FLOWN[name]
    (problem,) = verdict["problems"]
    assert (code, verdict["good"]) == (1, False)
    assert (problem["line"], problem["cue"]) == (line, cue)
    assert words in problem["text"]


def test_a_show_with_a_broken_rule_is_not_flown(capsys: pytest.CaptureFixture[str]) -> None:
    code, verdict = checked(capsys, BROKEN / "too-small.yaml")
    assert (code, verdict["good"]) == (1, False)
    assert verdict["problems"][0]["line"] == 19
    assert main(["show", "check", str(BROKEN / "too-small.yaml")]) == 1
    assert "too-small.yaml: line 19: cue 'change'" in capsys.readouterr().err


@pytest.mark.soak
def test_the_table_names_every_cue(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "check", str(BROKEN / "battery-too-small.yaml")]) == 1
    reported = capsys.readouterr().out
    assert all(name in reported for name in ("begin", "change", "end", "battery", "closest"))


def test_vertical_overlaps_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Six stand on a sphere, one above another."""
    file, cue = (
        tmp_path / "short.yaml",
        "{cue: stand, at_s: 0, radius_m: 8, height_m: 16, target: {x_m: 3, y_m: 1}}",
    )
    begin = TEXT.partition("timeline:")[0].replace("vehicles: 4", "vehicles: 6").replace("42.0", "10.0")
    file.write_text(f"{begin}timeline:\n  - {cue}\n")
    assert main(["show", "check", str(file)]) == 0
    (line,) = [reported for reported in capsys.readouterr().out.splitlines() if "columns of" in reported]
    assert "pairs overlap: " in line
    assert " above " in line


def test_the_hash_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "hash", "lighthouse"]) == 0
    assert len(capsys.readouterr().out.strip()) == 64


@pytest.mark.soak
def test_a_show_is_drawn(tmp_path: Path) -> None:
    picture = tmp_path / "show.png"
    assert main(["show", "plot", "figure-of-eight", str(picture)]) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_picture_needs_a_folder_that_exists(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "plot", "lighthouse", "nowhere/show.png"]) == 2
    assert "nowhere/show.png: there is no folder nowhere" in capsys.readouterr().err
