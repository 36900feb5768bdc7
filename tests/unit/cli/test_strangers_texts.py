"""Texts of strangers reach no terminal as they are, and no terminal or damaged file ends in a traceback."""

import json
import os
import sqlite3
import subprocess
import sys
from contextlib import closing
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from threading import Thread

import pytest

from gcs.cli import main
from gcs.client.http import Exchange
from gcs.config.yaml_files import Source
from gcs.model.errors import FileError, GcsError, cut, quoted, visible
from gcs.recording.audit_reader import AUDIT, last_known
from gcs.recording.session import Record
from gcs.service import ActiveFailsafe
from gcs.service.event_log import words
from tests.support.api_harness import Api

CLEARS = "\x1b[2J\x9b1m\u202eevil"


@pytest.mark.parametrize("sign", ["\x00", "\x07", "\x1b", "\r", "\x7f", "\x9b", "\u202e", "\u2067", "\ud800"])
def test_what_a_terminal_obeys_is_written_out(sign: str) -> None:
    shown = repr(sign)[1:-1]
    assert shown.isprintable()
    assert visible(f"é\t{sign}\nb") == f"é\t{shown}\nb"
    event = words("alarm", {"severity": "x", "text": f"a\n{sign}"})
    for text in (cut(f"a{sign}"), quoted({"a": [sign]}), event):
        assert text.isprintable()


@pytest.mark.parametrize("text", [CLEARS, "two\nlines", "\ud800"])
def test_the_api_takes_no_control_characters(text: str) -> None:
    body = json.dumps({"reason": text}).encode()
    headers = {"Content-Type": "application/json"}
    answer = Api()("POST", "/api/v1/vehicles/d1/exclude", content=body, headers=headers)
    assert answer.status_code == 422, answer.text
    assert answer.json()["problems"][0]["field"] == "reason"
    assert "without control characters" in answer.json()["detail"]


def answered(body: bytes, status: int) -> GcsError | ActiveFailsafe:
    """What the client makes of an answer, however it got into the service."""

    class Service(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(status)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            pass

    def declared() -> ActiveFailsafe: ...  # type: ignore[empty-body]

    with HTTPServer(("127.0.0.1", 0), Service) as server:
        thread = Thread(target=server.handle_request)
        thread.start()
        with closing(Exchange(f"http://127.0.0.1:{server.server_port}", None, None, None, 60.0)) as exchange:
            try:
                found: ActiveFailsafe = exchange.call("GET", "/", declared)
            except GcsError as error:
                return error
            finally:
                thread.join()
        return found


def test_texts_of_a_service_reach_its_clients_visibly() -> None:
    text = CLEARS + "\\u001b"
    failsafe = {
        "cause": text,
        "action": "hold",
        "reason": text,
        "vehicles": [text],
        "command_id": None,
        "since_s": 0.0,
        "since_unix_time_s": 0.0,
    }
    found = answered(json.dumps(failsafe, ensure_ascii=False).encode(), 200)
    assert isinstance(found, ActiveFailsafe)
    assert found.reason == found.vehicles[0] == visible(text)
    refused = {"detail": text, "problems": []}
    assert str(answered(json.dumps(refused).encode(), 409)) == visible(text)


def test_an_error_of_a_file_is_visible(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "hash", f"{tmp_path}/\x1b[2J.yaml"]) == 2
    assert "\x1b" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('about: "\\U00110000"\nkind: x\n', "f.yaml: line 1: not YAML: an escape beyond Unicode"),
        ('kind: x\nabout: "\\ud800"\n', "f.yaml: line 2: column 8: character U+D800 is not allowed"),
        ('kind: x\nabout: "\\e[2J"\n', "f.yaml: line 2: column 8: character U+001B is not allowed"),
    ],
)
def test_an_escape_in_a_file_is_refused_by_its_place(text: str, says: str) -> None:
    with pytest.raises(FileError) as refused:
        Source(text, "f.yaml")
    assert str(refused.value) == says


@pytest.mark.parametrize("config", ["{", "[]", "", "7", "[" * 100_000])
def test_an_audit_whose_configuration_is_none_is_named(
    config: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Record(tmp_path, "{}", {"d1": (1, "radio")}):
        pass
    with closing(sqlite3.connect(tmp_path / AUDIT)) as file, file:
        file.execute("UPDATE sessions SET config = ?", (config,))
    with pytest.raises(GcsError, match="damaged: the configuration is no JSON"):
        last_known(tmp_path)
    assert main(["report", str(tmp_path)]) != 0
    assert main(["kill", "d1", "--direct", "--record", str(tmp_path)]) != 0
    errors = capsys.readouterr().err.splitlines()
    assert [line for line in errors if not line.startswith("gcs: ")] == []


@pytest.mark.parametrize(("name", "value"), [("PYTHONIOENCODING", "ascii"), ("LC_ALL", "C")])
def test_an_output_of_ascii_shows_all_other_characters(name: str, value: str, tmp_path: Path) -> None:
    environment = {**os.environ, name: value, "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    command = [sys.executable, "-m", "gcs", "key", "create", str(tmp_path / "\u00fcb\u2026.key")]
    done = subprocess.run(command, capture_output=True, env=environment, check=False, timeout=120)
    assert done.returncode == 0, done.stderr.decode()
    assert rb"\u" in done.stdout
