"""What the command line refuses, and how it says so."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

import pytest

from gcs.sim import cli

if TYPE_CHECKING:
    from pathlib import Path

ARDUPILOT = ("--autopilot", "ardupilot")
MIXED = ("--autopilot", "mixed")
BOAT = ("--target", "boat", "--send")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--count", "0"], "whole number from 1 to 10000"),
        (["--count", "many"], "whole number from 1 to 10000"),
        (["--first", "-1"], "whole number from 0 to 9999"),
        (["--port-base", "70000"], "whole number from 1 to 65535"),
        (["--ports", "px4", "--port-base", "15000"], "not allowed with"),
        (["--wind", "1,2"], "three numbers with commas"),
        (["--grid-at", "1,2,3"], "two numbers with a comma"),
        (["--grid-at", "1,nan"], "two numbers with a comma"),
        (["--grid-heading", "400"], "not a number from -360 to 360"),
        (["--origin", "95,8,488"], "latitude goes from -90 to 90"),
        (["--noise", "nan"], "number from 0 to 100"),
        (["--drag", "-1"], "number from 0 to 10"),
        (["--param", "COM_OBL_RC_ACT"], "NAME=VALUE"),
        (["--param", "COM_OBL_RC_ACT=half"], "NAME=VALUE"),
        (["--autopilot", "inav"], "invalid choice"),
        (["--grid-columns", "0"], "whole number from 1"),
        (["--quirk", "double-ack"], "NAME=on or NAME=off"),
        (["--quirk", "telepathy=off"], "no such quirk"),
        (["--namespace-size", "251"], "whole number from 1 to 250"),
        (["--telemetry-hz", "0"], "number from 0.1 to 250"),
        (["--control", "0"], "whole number from 1 to 65535"),
        (["--faults-from", "file"], "invalid choice"),
        (["--bogus"], "unrecognized arguments: --bogus"),
    ],
)
def test_bad_arguments_are_named_and_exit_with_two(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as exit_info:
        cli.main(arguments)
    assert exit_info.value.code == 2
    assert says in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--first", "9000", "--count", "1001"], "at most 1000 fit"),
        (["--port-base", "65530", "--count", "10"], "beyond port 65535"),
        (["--first", "1", "--count", "2", "--param", "RTL_CONE_ANG=0,0"], "2 values for vehicles up to"),
        (["--param", "COM_OBL_RC=5"], "COM_OBL_RC: PX4 v1.16.1 has no such parameter"),
        (["--param", "COM_OBL_RC_ACT=0.5"], "whole number"),
        (["--param", "WPNAV_ACCEL=250"], "PX4 v1.16.1 has no such parameter; see --autopilot"),
        ([*ARDUPILOT, "--param", "FENCE_ACTION=300"], "whole number from -128 to 127"),
        ([*ARDUPILOT, "--param", "WPNAV_ACCE=3"], "there are WPNAV_ACCEL, WPNAV_ACCEL_Z"),
        ([*ARDUPILOT, "--param", "COM_OBL_RC_ACT=5"], "ArduCopter 4.1.0-dev has no such parameter"),
        (["--autopilot-version", "1.19"], "PX4 v1.19 is not known; there are 1.14, 1.15, 1.16, 1.17, 1.18"),
        (["--autopilot-version", "4.5"], "PX4 v4.5 is not known"),
        ([*ARDUPILOT, "--autopilot-version", "4.8"], "there are 4.0, 4.1, 4.2, 4.3, 4.4, 4.5, 4.6, 4.7"),
        ([*MIXED, "--autopilot-version", "1.16,3.6"], "autopilot version '3.6' is not known"),
        ([*MIXED, "--autopilot-version", "1.16,1.17"], "'1.16,1.17': one of PX4 is possible"),
        (["--autopilot-version", "1.18", "--param", "COM_RC_STICK_OV=9"], "PX4 v1.18.0-beta has no such"),
        (["--target", "boa", "--send", "nmea"], "--target boa: there are still, walker, walk, rover"),
        (["--target", "boat"], "--target boat needs --send: nmea, gpsd, cot, mavlink, follow-target"),
        ([*BOAT, "cot", "--to", "tcp://a:1"], "--to tcp://a:1: --send cot needs udp://HOST:PORT"),
        ([*BOAT, "gpsd", "--to", "udp://a:1"], "--to udp://a:1: --send gpsd needs tcp://HOST:PORT"),
        ([*BOAT, "nmea", "--to", "udp://a:99999"], "needs udp://HOST:PORT"),
        ([*BOAT, "nmea", "--to", "udp://a..b:9"], "--to udp://a..b:9: 'a..b' is no host name"),
        ([*BOAT, "nmea", "--count", "2", "--ideal"], "--count, --ideal: of vehicles, and --target moves"),
        (["--send", "nmea", "--swap"], "--send, --swap: of a target; name its motion with --target"),
    ],
)
def test_arguments_that_do_not_fit_together_exit_with_two(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(arguments) == 2
    assert says in capsys.readouterr().err


def test_a_truth_file_that_cannot_be_written_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["--truth", str(tmp_path / "none" / "truth.jsonl")]) == 1
    assert "truth.jsonl: No such file or directory" in capsys.readouterr().err


def test_a_track_that_cannot_be_read_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--target", "none.csv", "--send", "nmea"]) == 1
    assert "--target none.csv: No such file or directory" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "sim: 1 vehicle, system id 1, udp 127.0.0.1:14540"),
        (["--autopilot", "ardupilot", "--count", "8"], "sim: 8 vehicles with ArduPilot, system ids 1-8"),
        (["--autopilot", "mixed", "--count", "8"], "sim: 8 vehicles with PX4 and ArduPilot in turn"),
    ],
)
def test_the_greeting_names_the_autopilot(arguments: list[str], says: str) -> None:
    parser = argparse.ArgumentParser()
    cli.add_arguments(parser)
    assert cli.greeting(parser.parse_args(arguments)).startswith(says)


def test_a_mixed_fleet_takes_parameters_of_both() -> None:
    parser = argparse.ArgumentParser()
    cli.add_arguments(parser)
    options = ["--autopilot", "mixed", "--param", "WPNAV_ACCEL=250", "--param", "COM_OBL_RC_ACT=5"]
    assert cli.destinations(parser.parse_args(options)) == [14540]


def test_a_version_can_be_chosen_for_each_kind() -> None:
    parser = argparse.ArgumentParser()
    cli.add_arguments(parser)
    options = [*MIXED, "--autopilot-version", "1.18,4.7", "--param", "WP_ACC=2.5"]
    assert cli.destinations(parser.parse_args(options)) == [14540]


def test_another_program_can_offer_the_same_arguments() -> None:
    parser = argparse.ArgumentParser()
    cli.add_arguments(parser.add_subparsers().add_parser("sim"))
    given = parser.parse_args(["sim", "--count", "3", "--param", "COM_OBL_RC_ACT=5", "--wind=-1,2,0"])
    assert (given.count, given.param, given.wind) == (3, [("COM_OBL_RC_ACT", 5.0)], (-1.0, 2.0, 0.0))
