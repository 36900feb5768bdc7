"""`gcs site`: checks, conversions and volumes of the shipped site, and their errors."""

import json
from pathlib import Path

import pytest

from gcs.areas.files.site_files import read_site
from gcs.cli.main import main
from gcs.config.schema import find, load
from gcs.config.yaml_files import shipped_folder

SHIPPED = shipped_folder() / "sites" / "lakeside.geojson"


def answered(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, object]]:
    code = main(["site", *arguments, "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_check_says_what_a_site_has(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["site", "check", "lakeside"]) == 0
    text = capsys.readouterr().out
    assert read_site(SHIPPED).digest in text
    assert "no-fly            old oak: 4 corners, 64 m^2, from 0 m to 18 m" in text
    assert "11 corners go to the autopilots" in text
    assert "is at latitude 47.39734, longitude 8.54500" in text
    code, document = answered(capsys, "check", str(SHIPPED))
    assert code == 0
    assert len(document["areas"]) == 5  # type: ignore[arg-type]


def test_convert_keeps_the_hash(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hashes = set()
    source = str(SHIPPED)
    for name in ("a.kml", "b.plan", "c.geojson"):
        code, document = answered(capsys, "convert", source, "-o", str(tmp_path / name))
        assert code == 0
        hashes.add(document["hash"])
        source = str(tmp_path / name)
    assert hashes == {read_site(SHIPPED).digest}


def test_volumes_are_printed_term_by_term(capsys: pytest.CaptureFixture[str]) -> None:
    """The shipped site is large enough by both computations."""
    assert main(["site", "volumes", "lakeside"]) == 0
    text = capsys.readouterr().out
    for words in (
        "authorities, PX4:",
        "S_RZ = 4 m/s x 1 s (LBA rev. 1.7)",
        "this fleet, PX4:",
        "flies on                             4.0 m  4 m/s x 1 s",
        "fall with drag and wind",
        "m larger",
    ):
        assert words in text
    assert "SMALLER" not in text
    code, document = answered(capsys, "volumes", "lakeside")
    assert code == 0
    for each in document["volumes"]:  # type: ignore[attr-defined]
        for extent in each["extents"]:
            summed = sum(term["value_m"] for term in extent["terms"])
            assert extent["value_m"] == pytest.approx(summed, abs=0.05)


def test_volumes_follow_parameters_as_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A vehicle that flies on for 3 s makes the site too small, and the exit code says so."""
    rows = [
        {"vehicle": "d3", "parameter": "COM_OF_LOSS_T", "value": 3.0},
        {"vehicle": "d4", "parameter": "x", "value": None},
    ]
    path = tmp_path / "params.json"
    path.write_text(json.dumps({"good": False, "rows": rows}))
    code, document = answered(capsys, "volumes", "lakeside", "--parameters", str(path))
    assert code == 1
    smaller = [each for each in document["compared"] if each["spare_m"] < 0.0]  # type: ignore[attr-defined]
    assert [(each["what"], each["method"]) for each in smaller] == [
        ("contingency volume, sideways", "this fleet"),
        ("contingency volume, upwards", "this fleet"),
    ]
    path.write_text('{"rows": [1]}')
    assert main(["site", "volumes", "lakeside", "--parameters", str(path)]) == 2
    assert "the output of gcs params check --config CONFIG --json is needed" in capsys.readouterr().err


def test_derive_writes_a_site_that_is_wide_enough(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "lakeside.geojson"
    assert main(["site", "volumes", "lakeside", "--derive", str(target)]) == 0
    text = find("lakeside").read_text().replace("sites/lakeside.geojson", str(target))
    (tmp_path / "derived.yaml").write_text(text)
    assert load(tmp_path / "derived.yaml").flight_site == read_site(target)
    capsys.readouterr()
    assert main(["site", "volumes", str(tmp_path / "derived.yaml")]) == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("check", "demo"), "it names no site: give it site: FILE.geojson"),
        (("volumes", "demo"), "it names no site"),
        (("check", "none.kml"), "none.kml: cannot be read"),
        (("convert", str(SHIPPED), "-o", "a.shp"), "a name that ends in .geojson"),
        (("convert", str(SHIPPED), "-o", "/proc/none/a.kml"), "cannot be written"),
    ],
)
def test_errors_are_words(arguments: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["site", *arguments]) == 2
    assert words in capsys.readouterr().err


def test_a_show_that_leaves_the_site_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """With cue, time and missing metres, before anything is flown."""
    assert main(["show", "check", "lighthouse", "--config", "lakeside", "--json"]) == 1
    problems = json.loads(capsys.readouterr().out)["problems"]
    lacks = [each for each in problems if "m are missing to" in each["text"]]
    assert lacks
    assert all(each["cue"] for each in lacks)
    assert all(" s of the show ('" in each["text"] for each in lacks)
