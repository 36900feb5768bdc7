"""The commands that call a running service, over real TCP: all of the API, its errors, its exit codes."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from math import nan
from pathlib import Path

import pytest
from rich.console import Console
from starlette.types import ASGIApp, Receive, Scope, Send

from gcs.api.app import create_app
from gcs.api.auth.authorization import Authorization
from gcs.api.auth.tokens import Tokens, create_token
from gcs.areas.files.site_files import read_site
from gcs.cli.alarms import newest
from gcs.cli.commands import ACTIONS, CALLS
from gcs.cli.main import main
from gcs.cli.status import board
from gcs.client import Client
from gcs.client.fleet_client import PlaybackCalls, PreflightCalls, ShowsCalls
from gcs.model.errors import RefusedError
from gcs.model.interrupted_flight import InterruptedFlight, Offer
from gcs.model.lifecycle import Phase as LifePhase
from gcs.model.lifecycle import ShowPhase
from gcs.service import CommandRecord, Features, Outcome, SelectedShow
from gcs.service.access import Role
from gcs.service.alarms import AlarmCause, Condition
from gcs.service.features import TargetsView, TargetView, TrackView, TrafficView
from gcs.shows import load, shipped
from tests.support.api_background import in_background
from tests.support.api_fake_service import FakeService
from tests.support.machine import free_ports
from tests.support.replays import FakeRecord
from tests.support.show_files import FIGURES
from tests.support.timecode import VIEW

pytestmark = pytest.mark.usefixtures("patient_api", "prompt_checks")

EVERYTHING = [
    "health",
    "ready",
    "metrics",
    "state",
    "phase",
    "facts",
    "features",
    "whoami",
    "recorded",
    "playback show",
    "playback set --paused yes --speed 4 --position-s 12.5",
    "playback report",
    "marks",
    "vehicle list",
    "vehicle show d1",
    "shows upload lighthouse FILE",
    "shows import night DRAWING",
    "shows drawing night",
    "shows placement night",
    "shows place night --x-m 3 --fit yes",
    "shows remove night",
    "shows list",
    "shows text lighthouse",
    "shows check lighthouse",
    "shows checked lighthouse",
    "good",
    "shows select lighthouse HASH",
    "shows seek lamp",
    "shows begin 9000000000",
    "shows cancel-begin",
    "timecode",
    "shows follow-external-clock no",
    "shows deselect",
    "shows remove lighthouse",
    "areas show",
    "areas text kml",
    "areas change SITE",
    "exclude d1 --reason cracked",
    "include d1",
    "law set article",
    "preflight d1 d2 d3",
    "go",
    "sign pads 1 2",
    "reopen pads 2",
    "weather --wind-m-s 4 --gust-m-s 6.5 --visibility-m 8000 --kp 2",
    "proposed",
    "confirm 3f2a9c01b4de",
    "start d1 d2 d3",
    "command list",
    "command show o1",
    "!",
    "pause",
    "resume",
    "formation",
    "radius 12",
    "height 30",
    "target show",
    "target list",
    "traffic",
    "target select boat",
    "target report boat 47.3977 8.5456 --north-m-s 1.5",
    "target hold",
    "target set -3 4 --velocity-x-m-s -0.5",
    "target set-geodetic 47.3977 8.5456",
    "orbit show",
    "orbit set --radius-m 5 --direction clockwise",
    "yaw show",
    "yaw set --policy fixed --heading-deg 45",
    "obstacle add 50 -20 2 3 15 --obstacle-id tower",
    "obstacle list",
    "obstacle show tower",
    "obstacle change tower 50 -20 2 3 9",
    "obstacle remove tower",
    "hold d1",
    "hold d2 d3",
    "join d1",
    "join --all",
    "land d1",
    "!",
    "return d1",
    "stop",
    "!",
    "kill d1 d2",
    "lost d3",
    "alarms",
    "acknowledge vehicle-lost-1",
    "acknowledge --all",
    "confirm-down d1",
    "find d2",
    "pilot d3",
    "take-control d3",
    "pilot d2",
    "pilot d3",
    "take-control --all",
    "return --all",
    "land --all",
    "abort",
    "interrupted",
    "cut-off",
    "take-over",
    "cut-off",
    "bring-home",
    "stations",
    "! north south",
    "stations --json",
    "lead take",
    "silent south",
    "station take-over south",
    "status",
]
"""In an order in which each is possible; `!` has every vehicle in the formation, with names that of a site of
these stations, `silent` has a station lost, `good` has a check end well,
`proposed` has a start proposed by another token, `recorded` makes it a replay."""

LIGHTHOUSE = next(path for path in shipped() if path.stem == "lighthouse")
SITE = LIGHTHOUSE.parents[1] / "sites" / "lakeside.geojson"
DRAWING = LIGHTHOUSE.with_name("drawn-30.skyc")
SHOW = load(LIGHTHOUSE).show


class Listening:
    """The app, and which operations were asked of it."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self.asked: set[tuple[str, str]] = set()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http":
            self.asked.add((scope["method"].lower(), scope["path"]))
        await self._app(scope, receive, send)


@contextmanager
def station(
    service: FakeService, monkeypatch: pytest.MonkeyPatch, authorization: Authorization | None = None
) -> Iterator[Listening]:
    """A service that `gcs` finds by its environment."""
    received = Listening(create_app(service, authorization=authorization))
    with in_background(received) as port:
        monkeypatch.setenv("GCS_URL", f"http://127.0.0.1:{port}")
        yield received


def become(service: FakeService, word: str, names: list[str]) -> None:
    """Have the service be of a site, or one of its stations lost, or have a timecode."""
    if word == "timecode":
        service.features = Features(timecode=VIEW)
    elif word == "proposed":
        service.propose("alice")
    elif word == "!":
        service.join_site(names)
        service.fly()
    else:
        service.silent_s[names[0]] = 2.5


def asked_of(service: FakeService, line: str, *options: str) -> int:
    """Carry out a line of EVERYTHING."""
    service.tick()
    word, *names = line.split()
    if word in {"!", "silent", "timecode", "proposed"}:
        become(service, word, names)
        return 0
    if word == "pilot":
        service.phases[names[0]] = LifePhase.PILOT
        return 0
    if word == "lost":
        service.conditions = (Condition(AlarmCause.VEHICLE_LOST, "no telemetry for 2.0 s", (names[0],)),)
        service.tick()
        return 0
    if word == "cut-off":
        offers = (Offer.TAKE_OVER, Offer.BRING_HOME)
        service.interrupted = InterruptedFlight(
            "s1", 1.0, ShowPhase.RUNNING, None, {}, offers, (), "", stalled=False
        )
        service.tick()
        return 0
    if word == "recorded":
        service.replaying = FakeRecord()
        return 0
    if word == "good":
        answer = {**FIGURES, "good": True, "problems": [], "model": SHOW.model_dump(mode="json")}
        service.shows.found("lighthouse", LIGHTHOUSE.read_bytes(), answer)
        return 0
    if word == "kill":
        with Client(os.environ["GCS_URL"]) as client:
            return main(["kill", "--confirm", client.arm_kill(names).code, *options])
    given = {"FILE": str(LIGHTHOUSE), "HASH": SHOW.digest, "DRAWING": str(DRAWING), "SITE": str(SITE)}
    return main([*(given.get(each, each) for each in line.split()), *options])


def test_there_is_a_command_for_every_operation_and_it_does_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    service = FakeService(folder=tmp_path)
    service.keep_site(read_site(SITE))
    with station(service, monkeypatch) as received:
        failed = {line: capsys.readouterr() for line in EVERYTHING if asked_of(service, line)}
    assert failed == {}
    document = create_app(service).openapi()["paths"]
    never_asked = {
        (method, path)
        for path, operations in document.items()
        for method in operations
        if not any(
            method == asked and re.fullmatch(re.sub(r"\{\w+\}", "[^/]+", path), where)
            for asked, where in received.asked
        )
    }
    assert never_asked == set()
    begun = {" ".join(line.split()[:2]) for line in EVERYTHING} | {line.split()[0] for line in EVERYTHING}
    assert {each.name for each in (*CALLS, *ACTIONS)} <= begun


@pytest.mark.soak
def test_with_json_every_command_prints_exactly_one_document(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    service = FakeService(folder=tmp_path)
    service.keep_site(read_site(SITE))
    reported: dict[str, object] = {}
    with station(service, monkeypatch):
        for line in EVERYTHING:
            if line.split()[0] in {
                "!",
                "silent",
                "timecode",
                "pilot",
                "lost",
                "cut-off",
                "recorded",
                "good",
                "proposed",
            }:
                asked_of(service, line)
                continue
            assert asked_of(service, line, "--json") == 0
            printed = capsys.readouterr()
            assert printed.err == ""
            reported[line] = json.loads(printed.out, parse_constant=pytest.fail)
    assert isinstance(reported["acknowledge --all"], list)
    assert isinstance(reported["acknowledge vehicle-lost-1"], dict)
    assert str(reported["metrics"]).startswith("# HELP")
    assert reported["obstacle remove tower"] is None


def test_refusal_of_one_of_several_is_one_line_and_one_document(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    service = FakeService()
    with station(service, monkeypatch):
        service.fly()
        assert main(["hold", "d8", "d1", "d9", "--json"]) == 1
        printed = capsys.readouterr()
        assert json.loads(printed.out)["outcomes"].keys() == {"d1"}
        (line,) = printed.err.splitlines()
        detail = json.loads(line)["error"]["detail"]
        assert "'d8'" in detail
        assert "'d9'" in detail
        assert main(["orbit", "set", "--direction", "up", "--json"]) == 2
        (problem,) = json.loads(capsys.readouterr().err)["error"]["problems"]
        assert (problem["field"], problem["value"]) == ("direction", "up")


@pytest.mark.parametrize("line", ["status --watch 0.1", "alarms --watch"])
def test_watch_with_json_prints_a_document_per_line(line: str, monkeypatch: pytest.MonkeyPatch) -> None:
    service = FakeService()
    command = [sys.executable, "-m", "gcs", *line.split(), "--json"]
    with (
        station(service, monkeypatch),
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as watching,
    ):
        assert watching.stdout is not None
        first, second = (json.loads(watching.stdout.readline()) for _ in range(2))
        watching.send_signal(signal.SIGINT)
        _, complaints = watching.communicate(timeout=60)
    assert first.keys() == second.keys()
    assert (watching.returncode, complaints) == (0, "")


def test_every_method_of_the_client_is_a_command() -> None:
    methods = {
        name
        for kind in (Client, PlaybackCalls, PreflightCalls, ShowsCalls)
        for name in vars(kind)
        if not name.startswith("_")
    }
    assert methods - {call.method.rpartition(".")[2] for call in CALLS} == {
        "alarms",  # gcs alarms, gcs acknowledge
        "acknowledge",
        "acknowledge_all",
        "stations",  # gcs stations
        "wait_for_check",
        "close",
        "wait_for",
        "wait_until_ready",  # gcs preflight --wait
        "command",
        "command_vehicles",
        "arm_kill",  # gcs kill has both steps
        "confirm_kill",
    }


def test_command_prints_its_vehicles_and_reads_print_json(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    service = FakeService()
    with station(service, monkeypatch):
        assert main(["start", "d1", "d2"]) == 0
        assert capsys.readouterr().out == "o1 show start: pending\n  d1: pending\n  d2: pending\n"
        service.finish("o1", Outcome.FAILED, "no GPS")
        assert main(["command", "show", "o1"]) == 1
        assert capsys.readouterr().out.endswith("  d1: failed, no GPS\n  d2: failed, no GPS\n")
        assert main(["command", "show", "o1", "--json"]) == 1
        assert json.loads(capsys.readouterr().out)["outcomes"]["d1"]["reason"] == "no GPS"
        service.tick()
        assert main(["state"]) == 0
        assert json.loads(capsys.readouterr().out)["show"]["phase"] == "preflight"


def test_wait_for_a_command_sets_the_exit_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    service = FakeService()

    def fail_o2() -> None:
        while "o2" not in [command.id for command in service.command_log.newest()]:
            time.sleep(0.05)
        service.finish("o2", Outcome.FAILED, "it did not land")

    with station(service, monkeypatch):
        assert main(["start", "--wait", "0.2"]) == 1
        assert "show start not done after 0.2 s by d1, d2, d3" in capsys.readouterr().err
        service.fly()
        failing = threading.Thread(target=fail_o2)
        failing.start()
        assert main(["stop", "--wait", "30"]) == 1
        failing.join()
        assert "d1: failed, it did not land" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("line", "code", "stated"),
    [
        ("radius 1", 2, "radius_m = 1.0: at least 5.2 m for 3 vehicles"),
        ("target set nan 0", 2, "x_m = NaN"),
        ("orbit set", 2, "at least one field"),
        ("orbit set --direction up", 2, "direction = up: 'clockwise' or 'counterclockwise'"),
        ("pause", 1, "not possible while the show is idle"),
        ("kill d9", 1, "there is no vehicle 'd9'"),
        ("vehicle show ../d1", 1, "there is no /api/v1/vehicles/../d1 here"),
        ("command show o9", 1, "there is no command o9"),
        ("state --url http://127.0.0.1:9", 3, "no answer from http://127.0.0.1:9"),
        ("state --url nonsense", 3, "no answer from nonsense"),
        ("state --ca-file none.pem", 2, "none.pem: no PEM certificate"),
        ("shows upload mine none.yaml", 2, "file = none.yaml: a file to read: No such file"),
        ("shows checked mine", 1, "mine"),
        ("exclude d9", 1, "there is no vehicle 'd9'"),
        ("include d1", 1, "d1 was not taken out"),
        ("preflight d9", 1, "there is no vehicle 'd9'"),
        ("exclude d1 --reason " + 201 * "x", 2, "reason = xxx"),
        ("shows seek turn", 1, "no show is selected"),
        (f"start --show-hash {'0' * 64}", 1, "not the hash of the show that is selected"),
        ("start --show-hash 12", 2, "show_hash = 12"),
        ("start --at-unix-time-s nan", 2, "at_unix_time_s = NaN"),
        ("playback show", 1, "this service flies vehicles, and replays nothing"),
        ("playback set", 2, "at least one field"),
        ("playback set --speed 0", 2, "speed = 0.0: "),
    ],
)
def test_refusals_have_an_exit_code_for_each_kind(
    line: str, code: int, stated: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with station(FakeService(), monkeypatch):
        assert main(line.split()) == code
    assert stated in capsys.readouterr().err


@pytest.mark.parametrize(
    "line",
    [
        "target set 1",
        "playback set --paused maybe",
        "radius big",
        "hold",
        "hold d1 --all",
        "confirm-down",
        "obstacle",
        "dance",
        "hold --wait x d1",
    ],
)
def test_invalid_arguments_reach_no_service(
    line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with station(FakeService(), monkeypatch) as received, pytest.raises(SystemExit) as ended:
        main(line.split())
    assert (ended.value.code, received.asked) == (2, set())
    assert "usage: gcs" in capsys.readouterr().err


def test_refusal_of_one_vehicle_does_not_stop_the_others(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    service = FakeService()
    service.fly()
    with station(service, monkeypatch):
        assert main(["land", "d1", "d9", "d2"]) == 1
    assert [service.phases[name] for name in ("d1", "d2", "d3")] == [
        LifePhase.LANDING,
        LifePhase.LANDING,
        LifePhase.FORMATION,
    ]
    assert "d9" in capsys.readouterr().err


def test_a_token_comes_from_the_environment_or_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "tokens.json"
    watch, crew = (create_token(file, role.value, role) for role in (Role.WATCH, Role.OPERATE))
    with station(FakeService(), monkeypatch, Authorization(Tokens(file))):
        assert main(["state"]) == 4
        assert "a token is needed" in capsys.readouterr().err
        monkeypatch.setenv("GCS_TOKEN", watch)
        assert main(["state"]) == 0
        assert main(["start"]) == 4
        assert "watch may not: this needs a token of role operate" in capsys.readouterr().err
        assert main(["start", "--token", crew]) == 0
        assert main(["state", "--token", "käse"]) == 2


def test_status_shows_positions_and_problems(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    service = FakeService()
    service.fly()
    service.phases["d3"] = LifePhase.LOST
    service.selected = SelectedShow("tour", "ab" * 32, "walk", ("walk",), 3.25, 60.0, True, False)
    service.start_unix_s = time.time() + 3600.0
    service.tick()
    monkeypatch.setenv("COLUMNS", "140")
    with station(service, monkeypatch):
        assert main(["status", "--once"]) == 0
        shown = capsys.readouterr().out
        assert main(["status", "--once", "--url", "http://127.0.0.1:9"]) == 3
    assert re.search(r"tour: walk +3\.2 of 60\.0 s", shown)
    assert re.search(r"countdown 3\d{3}\.\d s", shown)
    for words in (["running"], ["nearest two 5.0 m"], ["d1", "formation", "75%"], ["d3", "lost", "?"]):
        assert any(all(word in line for word in words) for line in shown.splitlines()), words
    assert "separation from d9" in shown
    assert "no answer" in capsys.readouterr().err


def test_preflight_prints_failures_and_sets_the_exit_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    service = FakeService()
    monkeypatch.setenv("COLUMNS", "160")
    with station(service, monkeypatch):
        assert main(["preflight"]) == 0
        good = capsys.readouterr().out
        assert main(["exclude", "d2", "--reason", "cracked"]) == 0
        service.battery = 0.2
        capsys.readouterr()
        assert main(["preflight"]) == 1
        bad = capsys.readouterr().out
        assert main(["preflight", "--json"]) == 1
        reported = json.loads(capsys.readouterr().out)
        assert main(["preflight", "--all"]) == 1
        everything = capsys.readouterr().out
        service.fly()
        assert main(["preflight"]) == 1
        assert "preflight is for the ground" in capsys.readouterr().err
    assert "ready to start: 3 of 3 vehicles, 4 of 4 checks pass" in good
    assert "battery" not in good
    assert "not checked: start pattern: there is none" in good
    assert "not ready to start: 2 of 3 vehicles, 1 of 3 checks pass" in bad
    assert "1. d1, d3: battery at 20%, at least 25% is needed\n  charge it\n" in bad
    (line,) = (line for line in everything.splitlines() if "│ d1" in line)
    for words in ("battery", "fail", "0.20 of 1", "at least 25%", "battery at 20%"):
        assert words in line
    assert "not flying: d2: taken out of the show by local: cracked" in bad
    assert (reported["passes"], reported["not_flying"]["d2"].endswith("cracked")) == (False, True)
    assert reported["fleet"][0]["value"] is None, "what is no number is null"
    assert "vehicles" in everything


class OnceRefused(FakeService):
    """Refuses each command to the show, for two causes."""

    def command_show(self, *_: object, **__: object) -> CommandRecord:
        raise RefusedError("1. d1: battery at 10%; charge it; 2. d3: no fix; wait; follows: place: d3")


def test_refused_start_has_a_line_for_each_cause(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with station(OnceRefused(), monkeypatch):
        assert main(["start"]) == 1
    lines = ["gcs: 1. d1: battery at 10%; charge it", "2. d3: no fix; wait", "follows: place: d3"]
    assert capsys.readouterr().err.splitlines() == lines


TARGET = TargetView("boat", "nmea", "tracked", "", 0.2, 5.0, 3.0, -40.0, 3.0, 4.0, 0.5, nan, 10.0, 9, 0)
TRACK = TrackView(
    "3C6444", "manned", 90.0, 0.0, 50.0, -30.0, 0.0, nan, 5.0, 0.4, 75.0, -24.0, 2.5, evaded=True, near=True
)


def test_targets_and_traffic_are_tables(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fake, targets = FakeService(), TargetsView("boat", (TARGET,), 6.4, 80.0, nan)
    traffic = TrafficView(3, 1, 1, "", 9, 0, 15.0, 10.0, (TRACK,))
    fake.features = replace(fake.features, targets=targets, traffic=traffic)
    fake.tick()
    with station(fake, monkeypatch):
        assert main(["target", "list"]) == 0
        boats = capsys.readouterr().out.splitlines()
        assert main(["traffic"]) == 0
        nearest = capsys.readouterr().out.splitlines()
        assert main(["traffic", "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["nearest"][0]["nearest_m"] == -24.0
    assert boats[0] == "selected: boat; the centre is ? m off it"
    assert boats[2].startswith("target  state    source  age s")
    assert boats[3].split() == ["boat", "tracked", "nmea", "0.2", "3.0", "-40.0", "5.0", "10.0"]
    assert nearest[0] == "3 tracks, 1 come near, 1 manned too near"
    assert " ".join(nearest[2].split()) == "3C6444 manned 75.0 0.0 2.5 50.0 30.0 0.4 near evaded"


def test_preflight_waits_until_a_start_would_be_accepted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    service = FakeService()
    service.battery = 0.2
    with station(service, monkeypatch):
        assert main(["preflight", "--wait", "0.5"]) == 1
        assert "not ready to start" in capsys.readouterr().out
        charged = threading.Timer(0.5, lambda: setattr(service, "battery", 0.9))
        charged.start()
        assert main(["preflight", "--wait", "60"]) == 0
        charged.join()
        assert "not ready" not in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["preflight", "--wait", "-1"])


def test_preflight_waits_for_a_service_that_starts(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    port = free_ports()
    monkeypatch.setenv("GCS_URL", f"http://127.0.0.1:{port}")
    assert main(["preflight", "--wait", "0.5"]) == 3
    assert "no answer" in capsys.readouterr().err
    with ExitStack() as running:
        late = in_background(create_app(FakeService()), port)
        starts = threading.Timer(0.5, lambda: running.enter_context(late))
        starts.start()
        assert main(["preflight", "--wait", "60"]) == 0
        starts.join()


def test_status_reports_no_answer_instead_of_old_state() -> None:
    with Client("http://127.0.0.1:9") as client:
        console = Console(width=100)
        with console.capture() as shown:
            console.print(newest(client.fleet, lambda fleet: board(fleet, console.width)))
    assert shown.get().startswith("NO STATE: no answer from http://127.0.0.1:9")
