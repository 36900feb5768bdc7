"""`gcs serve` and `gcs key` for the stations of a site: what is refused, and what is printed and written."""

import argparse
import json
import logging
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from gcs.cli.main import main
from gcs.cli.output import lines
from gcs.cli.service import supervisor
from gcs.cli.service.process import JsonLines
from gcs.cli.service.serve import load_here
from gcs.config.schema import find
from gcs.model.errors import ConfigError


@pytest.fixture(autouse=True)
def unchanged_log() -> Iterator[None]:
    """`gcs serve` sets up the log of its process, which is this one here."""
    loggers = logging.getLogger(), logging.getLogger("gcs")
    before = [(list(each.handlers), each.level) for each in loggers]
    yield
    for each, (handlers, level) in zip(loggers, before, strict=True):
        each.handlers[:] = handlers
        each.setLevel(level)


@pytest.mark.parametrize(
    ("line", "reported"),
    [
        (
            "serve --config stations",
            "gcs: stations: it has the stations north, east, south, west: --station NAME, or --all",
        ),
        ("serve --config demo --all", "it has no stations, so leave --all out"),
        ("serve --config demo --station north", "no station 'north'; stations: none in this configuration"),
        (
            "serve --config stations --station nord",
            "there is no station 'nord'; stations: north, east, south, west",
        ),
        ("serve --config stations --all --port 9000", "--port 9000: with --all each station has an api.port"),
        ("params check --config demo --station north", "no station 'north'"),
        ("key site keys --config demo", "it has no stations, which need no keys then"),
    ],
)
def test_stations_that_do_not_fit_the_file_are_refused(
    line: str, reported: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(line.split()) == 2
    assert reported in capsys.readouterr().err


def test_one_station_or_all_but_not_both(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["serve", "--config", "stations", "--station", "north", "--all"])
    assert ended.value.code == 2
    assert "not allowed with argument" in capsys.readouterr().err


def test_a_station_loads_its_own_part_and_that_of_the_site() -> None:
    config, site = load_here("stations", "east")
    assert config.ids == ("e1", "e2", "e3", "e4")
    assert site is not None
    assert len(site.ids) == 16
    assert load_here("demo")[1] is None


def test_only_addresses_of_that_station_must_be_local(tmp_path: Path) -> None:
    raw = yaml.safe_load(find("stations").read_text(encoding="utf-8"))
    raw["bus"]["keys"] = "keys"
    raw["links"][1]["listen"] = "udpin://192.0.2.1:15101"
    raw["stations"][1]["endpoint"] = {"host": "192.0.2.1", "port": 7442}
    file = tmp_path / "site.yaml"
    file.write_text(yaml.safe_dump(raw, sort_keys=False), encoding="utf-8")
    assert load_here(str(file), "north")[0].ids == ("n1", "n2", "n3", "n4")
    with pytest.raises(ConfigError) as refused:
        load_here(str(file), "east")
    assert "links.1.listen = 'udpin://192.0.2.1:15101': this computer has no address" in str(refused.value)
    assert "stations.1.endpoint.host = '192.0.2.1': this computer has no such" in str(refused.value)


def test_standby_listens_at_its_own_address_and_not_the_owners(tmp_path: Path) -> None:
    raw = yaml.safe_load(find("stations").read_text(encoding="utf-8"))
    north, east = raw["stations"][:2]
    raw["links"][0]["listen"] = "udpin://192.0.2.1:15100"
    east["standby"] = [{"link": north["links"][0], "listen": "udpin://127.0.0.1:15110"}]
    file = tmp_path / "site.yaml"
    file.write_text(yaml.safe_dump(raw, sort_keys=False), encoding="utf-8")
    assert len(load_here(str(file), "east")[0].ids) == 8
    east["standby"][0]["listen"] = "udpin://198.51.100.1:15110"
    file.write_text(yaml.safe_dump(raw, sort_keys=False), encoding="utf-8")
    with pytest.raises(ConfigError) as refused:
        load_here(str(file), "east")
    assert "stations.1.standby.0.listen = 'udpin://198.51.100.1:15110': this computer has no" in str(
        refused.value
    )
    assert "links.0" not in str(refused.value)


def test_every_line_of_a_station_names_it(capsys: pytest.CaptureFixture[str]) -> None:
    for as_json in (False, True):
        lines(argparse.Namespace(json=as_json, station="north"))("serving", "serving 4 vehicles", vehicles=4)
    text, document = capsys.readouterr().out.splitlines()
    assert text == "north: serving 4 vehicles"
    assert json.loads(document) == {
        "event": "serving",
        "station": "north",
        "text": "serving 4 vehicles",
        "vehicles": 4,
    }
    record = logging.makeLogRecord({"name": "gcs.x", "levelname": "INFO", "msg": "late"})
    assert json.loads(JsonLines("north").format(record))["station"] == "north"
    assert "station" not in json.loads(JsonLines().format(record))


def test_an_error_of_a_station_names_it(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["serve", "--config", "stations", "--station", "north", "--port", "70000"]
    assert main(words) == 2
    assert capsys.readouterr().err.startswith("north: gcs: with --host and --port: ")
    assert main([*words, "--json"]) == 2
    assert json.loads(capsys.readouterr().err)["error"]["station"] == "north"


def test_with_all_each_station_gets_its_own_supervisor() -> None:
    assert supervisor.is_requested(["serve", "--config", "stations", "--supervised", "--station", "north"])
    assert not supervisor.is_requested(["serve", "--config", "stations", "--supervised", "--all"])


def test_keys_of_a_site_are_written_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "keys"
    assert main(["key", "site", str(folder), "--config", "stations", "--json"]) == 0
    written = json.loads(capsys.readouterr().out)
    assert written["folder"] == str(folder)
    assert sorted(written["files"]) == sorted(path.name for path in folder.iterdir())
    assert {"ca.pem", "north.pem", "north.key", "west.key"} <= set(written["files"])
    assert {stat.S_IMODE(path.stat().st_mode) for path in folder.iterdir()} == {0o600}
    assert main(["key", "site", str(folder), "--config", "stations"]) == 2
    assert "exists already, and is not overwritten" in capsys.readouterr().err
