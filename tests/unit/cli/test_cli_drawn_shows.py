"""`gcs show import` and `gcs show export` as a user runs them."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gcs.cli.main import find_parser, main
from gcs.config import schema as configuration
from gcs.config.yaml_files import shipped_folder
from gcs.recording import mcap_layout as layout
from gcs.recording.mcap_writer import FlightFile
from gcs.shows import load
from gcs.shows.drawn import DrawnShow
from gcs.shows.formats import read_drawing
from gcs.shows.formats.files import IMPORTED
from tests.support.drawing_files import HOVER, skyc, zipped
from tests.support.record_samples import ids_of, sample

SHIPPED = shipped_folder() / "shows" / "drawn-30.skyc"


def test_import_writes_a_show_and_its_drawing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "night.yaml"
    assert main(["show", "import", str(SHIPPED), "-o", str(target), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["vehicles"], found["duration_s"], found["flown_s"]) == (30, 70.0, [0.0, 70.0])
    assert found["notes"] == []
    assert "# The drawing has yaw: it is flown with 'yaw: drawn'" in target.read_text()
    assert load(target).show.fleet.vehicles == 30
    assert (tmp_path / "night.skyc").read_bytes() == SHIPPED.read_bytes()


def test_an_import_reads_the_drawing_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A large drawing takes most of a second to read, and an upload waits for it."""
    files: list[str] = []
    read = IMPORTED[".skyc"]

    def counted(data: bytes, file: str) -> DrawnShow:
        files.append(file)
        return read(data, file)

    monkeypatch.setitem(IMPORTED, ".skyc", counted)
    assert main(["show", "import", str(SHIPPED), "-o", str(tmp_path / "night.yaml")]) == 0
    assert "30 vehicles" in capsys.readouterr().out
    assert files == ["drawn-30.skyc"]


def test_an_import_loads_no_simulation(tmp_path: Path) -> None:
    """The API imports for requests: what it does not need costs most of its time."""
    target = str(tmp_path / "night.yaml")
    script = (
        "import sys; from gcs.cli.main import main; code = main(sys.argv[1:]);"
        "sys.exit(code or any(name.startswith('gcs.simulation.rehearsal') for name in sys.modules))"
    )
    command = [sys.executable, "-c", script, "show", "import", str(SHIPPED), "-o", target]
    assert subprocess.run(command, check=False, capture_output=True).returncode == 0


def test_an_import_never_replaces_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "night.yaml"
    target.write_text("mine")
    assert main(["show", "import", str(SHIPPED), "-o", str(target)]) == 2
    assert "there is such a file already" in capsys.readouterr().err
    assert target.read_text() == "mine"
    assert not (tmp_path / "night.skyc").exists()


@pytest.mark.parametrize("suffix", [".skyc", ".zip", ".vviz"])
def test_export_writes_the_drawing_of_a_show(suffix: str, tmp_path: Path) -> None:
    assert main(["show", "import", str(SHIPPED), "-o", str(tmp_path / "a.yaml"), "--json"]) == 0
    out = tmp_path / f"out{suffix}"
    assert main(["show", "export", str(tmp_path / "a.yaml"), "-o", str(out), "--json"]) == 0
    if suffix == ".vviz":
        assert len(json.loads(out.read_text())["performances"]) == 30
    else:
        assert len(read_drawing(out)[0]) == 30


def test_a_broken_file_leaves_nothing_behind(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken, target = tmp_path / "broken.skyc", tmp_path / "night.yaml"
    broken.write_bytes(zipped({"show.json": "{"}))
    assert main(["show", "import", str(broken), "-o", str(target)]) == 2
    assert "broken.skyc: show.json: not JSON" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["broken.skyc"]


@pytest.mark.parametrize(
    ("option", "given", "words"),
    [
        ("--origin", "47.4,8.5,488", "argument --origin: 47.4,8.5,488: 4 numbers with commas between them"),
        ("--origin", "a,b,c,d", "are needed: LAT,LON,ALT,HEADING"),
        ("--origin-else", "nan,8.5,488,0", "argument --origin-else: nan,8.5,488,0: 4 numbers"),
        ("--origin", "99,8.5,488,0", "--origin: latitude_deg = 99.0: between -90 and 90 degrees"),
        ("-o", "none/a.yaml", "-o none/a.yaml: there is no folder none: make it first"),
        ("-o", "a.yml", "-o a.yml: a name that ends with .yaml is needed"),
    ],
)
def test_a_wrong_option_is_explained(
    option: str, given: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code: object = main(["show", "import", str(SHIPPED), "-o", str(tmp_path / "a.yaml"), option, given])
    except SystemExit as ended:
        code = ended.code
    assert code == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("action", ["check", "hash", "sample"])
def test_a_drawing_in_place_of_a_show(action: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", action, str(SHIPPED)]) == 2
    assert f"make a show of it first: gcs show import {SHIPPED} -o drawn-30.yaml" in capsys.readouterr().err


def test_an_origin_can_be_given(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plain, target = tmp_path / "plain.skyc", tmp_path / "a.yaml"
    plain.write_bytes(zipped(skyc(HOVER)))
    assert main(["show", "import", str(plain), "-o", str(target)]) == 2
    assert (
        "no place on Earth: give the show's origin (--origin LAT,LON,ALT,HEADING)" in capsys.readouterr().err
    )
    at_site = tmp_path / "site.yaml"
    assert main(["show", "import", str(plain), "-o", str(at_site), "--config", "px4-sitl"]) == 0
    site = configuration.load(configuration.find("px4-sitl")).frame
    assert load(at_site).show.origin.frame == site
    assert main(["show", "import", str(plain), "-o", str(target), "--origin", "47.4,8.5,488,30"]) == 0
    origin = load(target).show.origin
    assert (origin.latitude_deg, origin.heading_deg) == (47.4, 30.0)


def test_a_recorded_flight_is_exported_as_it_flew(tmp_path: Path) -> None:
    """One vehicle climbs at 1 m/s and turns red; the other's position is never known."""
    config = configuration.load(configuration.find("demo"))
    file = FlightFile(
        tmp_path, layout.about("s1", config.model_dump_json(), dict.fromkeys(ids_of(2), (1, "a")))
    )
    file.open()
    for tick in range(200):
        place_m = np.array([[3.0, 4.0, -10.0 - 0.05 * tick], [np.nan, np.nan, np.nan]])
        colour = np.array([[255, 0, 0], [0, 0, 0]], np.uint8) * (tick >= 100)
        file.add(sample(time_s=100.0 + 0.05 * tick, position_m=place_m, colour=colour, number=tick))
    file.close()
    assert main(["show", "export", str(tmp_path), "-o", str(tmp_path / "a.skyc"), "--json"]) == 0
    show, _ = read_drawing(tmp_path / "a.skyc")
    assert show.vehicles == ("d1",)
    assert show.trajectories.at(4.0).position_m[0] == pytest.approx([3.0, 4.0, -14.0], abs=0.01)
    assert [show.lights.colours_at(time_s)[0, 0] for time_s in (4.0, 6.0)] == [0, 255]
    assert show.origin is not None
    assert show.origin.latitude_deg == pytest.approx(config.frame.latitude_deg, abs=1e-6)


def test_an_export_of_another_kind_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "export", "lighthouse", "-o", str(tmp_path / "a.txt")]) == 2
    assert ".skyc or .vviz or .zip" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "option", "value"),
    [
        ("show import a.zip -o a.yaml", "--origin", "-33.85,-70.6,20,0"),
        ("show import a.zip -o a.yaml", "--origin-else", "-.5,7,-2,0"),
        ("show place a.yaml", "--at", "-5,3,10"),
        ("show place a.yaml", "--frame", "-33.85,7,0,0"),
        ("show check a.yaml", "--wind", "-3,2"),
        ("show check a.yaml", "--box", "-1.5,18,1,1,60"),
        ("sim", "--origin", "-33.85,151.2,20"),
        ("sim", "--wind", "-3,0,0"),
        ("sim", "--grid-at", "-5,-5"),
    ],
)
def test_lists_may_begin_with_a_minus(command: str, option: str, value: str) -> None:
    """South of the equator, west, and the wind from the other side: as with an equals sign."""
    key = option[2:].replace("-", "_")
    taken = []
    for given in ([option, value], [f"{option}={value}"]):
        parser, rest = find_parser([*command.split(), *given])
        taken.append(getattr(parser.parse_args(rest), key))
    assert taken[0] == taken[1] is not None


def test_an_option_is_no_value(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["show", "place", "a.yaml", "--at", "--fit"])
    assert "--at: expected one argument" in capsys.readouterr().err
