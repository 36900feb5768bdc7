"""`gcs show place` as a user runs it."""

import json
from pathlib import Path

import pytest

from gcs.cli.main import main
from gcs.config.yaml_files import shipped_folder
from gcs.shows import load
from gcs.shows.placement import placed_pads_m, placement

SHIPPED = shipped_folder() / "shows"
Captured = pytest.CaptureFixture[str]


@pytest.fixture
def night(tmp_path: Path) -> Path:
    for suffix in ("yaml", "skyc"):
        (tmp_path / f"drawn-30.{suffix}").write_bytes((SHIPPED / f"drawn-30.{suffix}").read_bytes())
    return tmp_path / "drawn-30.yaml"


def vehicles(folder: Path, pads_m: list[list[float]]) -> Path:
    """Vehicles in the opposite order; the last one has no position."""
    places = {f"d{row + 1}": place_m for row, place_m in enumerate(reversed(pads_m))}
    path = folder / "vehicles.json"
    path.write_text(json.dumps(places | {"d99": None}))
    return path


def test_a_show_is_fitted_to_vehicles_and_written(night: Path, tmp_path: Path, capsys: Captured) -> None:
    there = placement(20.0, -8.0, 25.0)
    standing = vehicles(tmp_path, placed_pads_m(load(night).show, there).tolist())
    options = ["show", "place", str(night), "--fit", f"--vehicles={standing}"]
    assert main([*options, f"--output={night}", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["x_m"], found["y_m"], found["turn_deg"]) == pytest.approx((20.0, -8.0, 25.0), abs=0.05)
    assert found["max_m"] < 0.05
    assert {one["pad"] for one in found["vehicles"]} == {*range(30), None}
    moved = load(night).show
    assert moved.drawing is not None
    assert moved.drawing.place == placement(found["x_m"], found["y_m"], found["turn_deg"])
    assert moved.fence.distance_max_m == found["fence_distance_m"]

    assert main(["show", "place", str(night), f"--vehicles={standing}"]) == 0
    words = capsys.readouterr().out
    assert "turned by 25 deg clockwise" in words
    assert "d99: no position" in words


def test_what_is_not_given_stays(night: Path, capsys: Captured) -> None:
    assert main(["show", "place", str(night), "--at=3,,90", f"--output={night}"]) == 0
    assert "x 3 m" in capsys.readouterr().out
    assert main(["show", "place", str(night), "--at=,2,", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["x_m"], found["y_m"], found["turn_deg"]) == (3.0, 2.0, 90.0)
    assert found["stored"] == {"x_m": 3.0, "y_m": 0.0, "turn_deg": 90.0}


@pytest.mark.parametrize(
    ("options", "reported"),
    [
        (["--at=1,2"], "argument --at: 1,2: 3 numbers with commas between them are needed: X,Y,TURN"),
        (["--at=1,2,nan"], "argument --at: 1,2,nan: 3 numbers"),
        (["--at=1e9,2,0"], "--at: x_m = 1000000000.0: "),
        (["--frame=1,2"], "argument --frame: 1,2: 4 numbers with commas between them are needed"),
        (["--fit"], "nothing to fit to"),
        (["--vehicles=nowhere.json"], "an object with the place of each vehicle"),
        (["--output=out.txt"], "-o out.txt: a name that ends with .yaml is needed"),
    ],
)
def test_a_wrong_option_is_explained(
    options: list[str], reported: str, night: Path, capsys: Captured
) -> None:
    try:
        code: object = main(["show", "place", str(night), *options])
    except SystemExit as ended:
        code = ended.code
    assert code == 2
    assert reported in capsys.readouterr().err


def test_a_show_of_the_law_has_nothing_to_place(capsys: Captured) -> None:
    assert main(["show", "place", "lighthouse"]) == 2
    assert "the show has no drawing" in capsys.readouterr().err
