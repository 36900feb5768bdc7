"""Every command of `gcs` takes `--json`: one document of what it found, one line of JSON of an error."""

import argparse
import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from gcs.cli.commands import COMMANDS, LINES
from gcs.cli.main import main, whole_parser
from gcs.cli.output import JSON, Parser, failed, print_json
from gcs.model.errors import FileError, GcsError, InvalidError, Problem
from tests.support.machine import free_ports

NO_SERVICE = "http://127.0.0.1:9"


PARSERS: dict[str, Parser] = {leaf.prog.removeprefix("gcs "): leaf for leaf in whole_parser().leaves()}
"""The parser of each command that takes no further one, by its whole name."""

ASKING = [name for name, leaf in PARSERS.items() if "--url" in leaf.format_help()]


def error_of(captured: str) -> dict[str, object]:
    """The one error that was printed, and nothing else."""
    (line,) = captured.splitlines()
    document = json.loads(line)
    assert set(document) == {"error"}
    error: dict[str, object] = document["error"]
    assert set(error) == {"exit_code", "detail", "problems", "notes"}
    return error


def wrong(line: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, object]]:
    """The exit code and the error of a command that fails."""
    try:
        code = main(line.split())
    except SystemExit as ended:
        code = int(str(ended.code))
    printed = capsys.readouterr()
    assert printed.out == ""
    error = error_of(printed.err)
    assert error["exit_code"] == code
    return code, error


def words_for(leaf: Parser) -> list[str]:
    """Values for the arguments that a command must be given, as its usage names them."""
    usage = leaf.format_usage().removeprefix(f"usage: {leaf.prog} ").split()
    depth, words = 0, []
    for word in usage:
        depth += word.count("[")
        if depth == 0 and word.isupper():
            words.append("1")
        depth -= word.count("]")
    return words


def test_there_are_commands_to_look_at() -> None:
    assert len(PARSERS) > 75
    assert len(ASKING) > 55
    assert {"show check", "token list", "sim", "playback set", "confirm-down"} <= set(PARSERS)


@pytest.mark.parametrize("name", PARSERS)
def test_every_command_reports_wrong_arguments_as_json(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    code, error = wrong(f"{name} --no-such-option --json", capsys)
    assert code == 2
    assert error["detail"]
    assert JSON in PARSERS[name].format_help()


@pytest.mark.parametrize("name", ASKING)
def test_every_remote_command_reports_no_service_as_json(
    name: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    leaf = PARSERS[name]
    words = words_for(leaf) or (["1"] if "VEHICLE" in leaf.format_usage() else [])
    upload = tmp_path / "show.yaml"
    upload.write_text("show: x\n")
    files = {name: ["x", str(upload)] for name in ("shows upload", "shows import")}
    files["areas change"] = [str(upload)]
    given = {**files, "acknowledge": ["--all"], "shows follow-external-clock": ["no"]}.get(name, words)
    line = " ".join([name, *given, "--json", "--url", NO_SERVICE])
    if name == "kill":  # which then looks for the record
        assert main([*line.split(), "--record", str(tmp_path)]) == 1
        first, last = capsys.readouterr().err.splitlines()
        assert NO_SERVICE in json.loads(first)["note"]
        assert error_of(last)["exit_code"] == 1
        return
    code, error = wrong(line, capsys)
    assert code == 3
    assert NO_SERVICE in str(error["detail"])


@pytest.mark.parametrize(
    ("line", "code", "says"),
    [
        ("serve --config none.yaml --json", 2, "none.yaml"),
        ("params check --config none.yaml --json", 2, "none.yaml"),
        ("params check --config demo --wait 0 --json", 2, "--wait 0"),
        ("params check --config demo --vehicles x1 --json", 2, "no x1"),
        ("demo --vehicles 1 --json", 2, "2 to 50 is possible"),
        ("simulate none --json", 2, "none"),
        ("simulate --json", 2, "name a scenario"),
        ("replay none.mcap --json", 2, "none.mcap"),
        ("replay none.mcap --speed 0 --json", 2, "--speed 0"),
        ("report none.mcap --json", 2, "none.mcap"),
        ("show check none --json", 2, "none"),
        ("show hash none --json", 2, "none"),
        ("sim --count 2 --first 9999 --json", 2, "at most 1 fit"),
        ("sim --truth /no/such/folder/file --json", 1, "/no/such/folder/file"),
        ("files show none --json", 2, "there is no such file"),
        ("token list --file /no/such/folder/tokens.json --json", 1, "/no/such/folder/tokens.json"),
        ("key create /no/such/folder/key --json", 2, "/no/such/folder/key"),
        ("kil --json", 2, "did you mean kill?"),
        ("target --json", 2, "a word is missing"),
        ("target shw --json", 2, "did you mean show?"),
        ("show --json", 2, "action"),
        ("--json", 2, "a command is missing"),
    ],
)
def test_errors_are_one_json_line_with_the_text_exit_code(
    line: str, code: int, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    found, error = wrong(line, capsys)
    assert found == code
    assert says in str(error["detail"])
    plain = [word for word in line.split() if word != "--json"]
    try:
        as_text = main(plain)
    except SystemExit as ended:
        as_text = int(str(ended.code))
    assert as_text == code
    assert says in capsys.readouterr().err.replace("Nothing", "a command is missing")


@pytest.mark.parametrize(
    "line", ["files list", "files show operations.md", "completion bash", "show hash lighthouse", "--version"]
)
def test_found_commands_print_one_document(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*line.split(), "--json"]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)
    assert printed.err == ""


def test_after_two_dashes_json_is_an_ordinary_argument(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["vehicle", "show", "--url", NO_SERVICE, "--", "--json"]) == 3
    assert capsys.readouterr().err.startswith("gcs: no answer")


def test_file_lines_and_request_fields_are_separate_documents(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "mine.yaml"
    config.write_text("formation:\n  raduis_m: 15\n")
    _, error = wrong(f"serve --config {config} --json", capsys)
    problems = error["problems"]
    assert isinstance(problems, list)
    assert any(one["line"] == 2 and "radius_m" in one["text"] for one in problems)
    assert {one["file"] for one in problems} == {str(config)}

    def problems_of(reason: GcsError) -> object:
        failed(reason, argparse.Namespace(json=True))
        return error_of(capsys.readouterr().err)["problems"]

    assert problems_of(InvalidError("radius_m", float("nan"), "a number")) == [
        {"field": "radius_m", "value": None, "allowed": "a number"}
    ]
    assert problems_of(FileError("f", [Problem(3, None, "what")])) == [
        {"file": "f", "line": 3, "text": "what"}
    ]


def test_document_has_only_json_numbers(capsys: pytest.CaptureFixture[str]) -> None:
    print_json({"a": [float("nan"), 1.5], "b": (float("inf"),)})
    assert json.loads(capsys.readouterr().out, parse_constant=pytest.fail) == {"a": [None, 1.5], "b": [None]}


def test_continuous_commands_document_that_they_print_lines() -> None:
    assert {name for name, command in COMMANDS.items() if command.json == LINES} == {
        "demo",
        "serve",
        "simulate",
        "replay",
        "sim",
        "timecode",
    }


def test_fake_fleet_prints_its_addresses_as_json() -> None:
    command = [
        sys.executable,
        "-m",
        "gcs",
        "sim",
        "--count",
        "2",
        "--port-base",
        str(free_ports(2)),
        "--json",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as fleet:
        assert fleet.stdout is not None
        line = json.loads(fleet.stdout.readline())
        fleet.send_signal(signal.SIGINT)
        rest, _ = fleet.communicate(timeout=60)
    assert (line["event"], line["vehicles"], len(line["ports"])) == ("flying", 2, 2)
    assert (fleet.returncode, rest) == (0, "")
