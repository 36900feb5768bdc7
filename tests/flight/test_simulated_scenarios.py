"""`gcs simulate` as its users call it: figures, seeds, gates, plots, refusals."""

import json
from pathlib import Path
from typing import Any

import pytest
from PIL import Image, ImageSequence

from gcs.cli import main

TIMINGS = {"realtime_factor", "tick"}

UNGATED = "{formation.settled: , formation.energy_ratio: , formation.radius_share: }"

SHORT = """
like: {like}
about: short.
duration_s: {seconds}
judged: {{vehicles: [{vehicles}], seeds: 2, must: {must}, mostly: {{formation.in_time: }}}}
"""


@pytest.fixture
def trial(tmp_path: Path) -> Path:
    """Four drones for three seconds, which nothing is demanded of but separation."""
    return written(tmp_path, "assembly", 3, 4, UNGATED)


def written(folder: Path, like: str, seconds: float, vehicles: int, must: str = "{}") -> Path:
    path = folder / "trial.yaml"
    text = SHORT.format(like=like, seconds=seconds, vehicles=vehicles, must=must)
    path.write_text(text, encoding="utf-8")
    return path


def flown(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, list[dict[str, Any]]]:
    code = main(["simulate", "--json", "--workers", "1", *map(str, arguments)])
    return code, [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def untimed(figures: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in figures.items() if key not in TIMINGS}


@pytest.mark.soak
def test_same_seed_same_figures_another_seed_others(trial: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, (first,) = flown(capsys, trial, "--seed", "5")
    _, (again,) = flown(capsys, trial, "--seed", "5")
    _, (other,) = flown(capsys, trial, "--seed", "6")
    assert untimed(first) == untimed(again)
    assert first["formation"] != other["formation"]
    assert first["seed"] == 5


def test_row_of_the_table_selects_its_scenario(capsys: pytest.CaptureFixture[str]) -> None:
    code, (figures,) = flown(capsys, "--row", "saddle", "--seeds", "6000:6001")
    assert (figures["scenario"], figures["vehicles"], figures["seed"]) == ("square-start", 4, 6000)
    assert code == 0


def test_a_run_is_one_json_object_with_every_section(trial: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, (figures,) = flown(capsys, trial)
    assert figures["vehicles"] == 4
    assert figures["duration_s"] == 3.0
    assert set(figures["separation"]) == {"floor_m", "minimum_m", "violations", "lost_pairs"}
    assert set(figures["formation"]) >= {"settled", "settle_time_s", "straight_line_time_s", "energy_ratio"}
    assert figures["separation"]["floor_m"] == 2.0
    assert figures["separation"]["minimum_m"] > 2.0
    assert figures["tick"]["p50_ms"] > 0.0


def test_seeds_range_excludes_its_end_and_judged_come_from_file(
    trial: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert [run["seed"] for run in flown(capsys, trial, "--seeds", "3:6")[1]] == [3, 4, 5]
    assert [run["seed"] for run in flown(capsys, trial, "--judged")[1]] == [6000, 6001]


def test_unmet_demands_of_a_scenario_set_the_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    strict = written(tmp_path, "assembly", 3, 4, "{separation.minimum_m: {least: 50}}")
    assert main(["simulate", str(strict)]) == 1
    assert "separation.minimum_m" in capsys.readouterr().out


@pytest.mark.soak
def test_side_by_side_on_two_cores_the_figures_are_the_same(
    trial: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, alone = flown(capsys, trial, "--seeds", "1:3")
    main(["simulate", "--json", "--workers", "2", "--seeds", "1:3", str(trial)])
    beside = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [untimed(run) for run in alone] == [untimed(run) for run in beside]


def test_a_plot_is_drawn(trial: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "flight.png"
    assert main(["simulate", str(trial), "--plot", str(file)]) == 0
    assert file.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert "closest" in capsys.readouterr().out


@pytest.mark.soak
def test_a_plot_shows_what_its_law_is(trial: Path, tmp_path: Path) -> None:
    file = tmp_path / "flight.svg"
    assert main(["simulate", str(trial), "--law", "flocking", "--plot", str(file)]) == 0
    drawn = file.read_text(encoding="utf-8")
    assert "trial, law flocking, 4 vehicles, seed 1" in drawn
    assert "Held back by the filter" in drawn, "it ends in no shape to compare with"
    assert "best known" not in drawn


@pytest.mark.soak
def test_a_flight_is_drawn_as_it_moves(tmp_path: Path) -> None:
    file = tmp_path / "flight.gif"
    assert main(["simulate", str(written(tmp_path, "assembly", 1, 3, UNGATED)), "--plot", str(file)]) == 0
    with Image.open(file) as picture:
        assert sum(1 for _ in ImageSequence.Iterator(picture)) == 10  # of 20 ticks


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        ([], "name a scenario"),
        (["nonsense"], "there is no such file"),
        (["assembly", "--vehicles", "0"], "at least 1"),
        (["assembly", "--all"], "one of them"),
        (["assembly", "--row", "shape"], "one of them"),
        (["assembly", "--seed", "1", "--seeds", "1:3"], "not both"),
        (["assembly", "--seeds", "1:3", "--plot", "x.png"], "one seed"),
        (["assembly", "--plot", "nowhere/x.png"], "--plot nowhere/x.png: there is no folder nowhere"),
        (["assembly", "--plot", "x.doc"], ".png"),
        (["square-start", "--vehicles", "5"], "square number"),
        (["swap-random", "--vehicles", "5000"], "do not fit"),
    ],
)
def test_impossible_run_is_refused_before_flight(
    arguments: list[str], reported: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", *arguments]) == 2
    assert reported in capsys.readouterr().err


@pytest.mark.parametrize("seeds", ["3", "3:", "5:2", "a:b"])
def test_bad_seeds_are_refused(seeds: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["simulate", "assembly", "--seeds", seeds])
    assert "A:B" in capsys.readouterr().err


@pytest.mark.soak
@pytest.mark.parametrize("seed", [6000, pytest.param(6001, marks=pytest.mark.soak)])
def test_both_autopilots_fly_the_story_as_one(seed: int, capsys: pytest.CaptureFixture[str]) -> None:
    seeds = f"{seed}:{seed + 1}"
    code, (figures,) = flown(capsys, "mixed-story", "--judged", "--vehicles", "8", "--seeds", seeds)
    assert code == 0
    assert figures["separation"]["violations"] == 0
    assert figures["arrival"]["arrived"] == 8
    assert figures["obstacles"]["penetrations"] == 0


@pytest.mark.soak
@pytest.mark.parametrize("scenario", ["target-in-hall", "target-held", "target-doors"])
def test_target_that_cannot_be_had_is_followed_from_beside_it(
    scenario: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, (figures,) = flown(capsys, scenario, "--seed", "6000", "--vehicles", "8")
    assert code == 0
    assert figures["formation"]["radius_error_m"] <= 0.5
    assert figures["obstacles"]["penetrations"] == 0
