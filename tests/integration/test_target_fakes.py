"""Fake targets on real sockets: as commands, and as a gpsd that clients ask."""

import asyncio
import json
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from math import nan
from typing import Any

import pytest
from pynmeagps import NMEAReader

from gcs.links.tak.settings import OwnTracks
from gcs.links.targets.receive import intake_of, keep_receiving_tracks
from gcs.links.targets.settings import CotTracks, MavlinkTracks
from gcs.model.target_fix import TargetFix
from gcs.sim.settings import Origin
from gcs.sim.targets import formats
from gcs.sim.targets.motions import motion
from gcs.sim.targets.reports import Errors, reports
from gcs.sim.targets.sending import ASKED_MAX, CLIENTS_MAX, GpsdServer, send
from tests.support.link_bench import until
from tests.support.machine import free_ports
from tests.support.target_fakes import Listening, source

WAIT_S = 60.0


@contextmanager
def running(*arguments: str) -> Iterator[dict[str, Any]]:
    """`gcs sim` with these arguments; what it prints first. It ends without a word."""
    command = [sys.executable, "-m", "gcs", "sim", *arguments, "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield json.loads(process.stdout.readline())
        process.send_signal(signal.SIGINT)
        assert (*process.communicate(timeout=WAIT_S), process.returncode) == ("", "", 0)


def test_command_sends_nmea_as_it_says() -> None:
    port = free_ports()
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as receiver:
        receiver.bind(("127.0.0.1", port))
        receiver.settimeout(WAIT_S)
        options = ("--target", "boat", "--rate", "20", "--double", "1", "--grid-at", "1000,0")
        to = f"udp://127.0.0.1:{port}"
        with running(*options, "--send", "nmea", "--to", to) as greeting:
            assert greeting == {
                "event": "sending",
                "text": f"sim: target boat, nmea, 20 a second, {to}",
                "vehicles": 0,
                "ports": [port],
            }
            datagrams = [receiver.recv(2000) for _ in range(10)]
    assert datagrams[0::2] == datagrams[1::2], "each twice"
    gga = NMEAReader.parse(datagrams[0].split(b"\r\n")[0] + b"\r\n", validate=1)
    assert gga.lat == pytest.approx(Origin().latitude_deg + 1000.0 / 111_180.0, abs=1e-4)


@pytest.mark.parametrize("form", ["mavlink", "follow-target"])
def test_command_is_received_as_a_target(form: str) -> None:
    port = free_ports()
    listening = Listening(source(port, system_id=42))
    options = ("--target", "straight", "--speed", "3", "--noise", "0.5", "--rate", "20")

    async def story() -> None:
        with running(*options, "--send", form, "--to", f"udp://127.0.0.1:{port}"):
            await until(lambda: len(listening.fixes) >= 40)

    asyncio.run(listening.while_(story))
    first, last = listening.fixes[5], listening.fixes[39]
    passed_s = last.source_s - first.source_s
    assert passed_s == pytest.approx(34 / 20, abs=0.01)
    assert (last.latitude_deg - first.latitude_deg) * 111_180 / passed_s == pytest.approx(3.0, abs=1.5)
    assert last.north_m_s == pytest.approx(3.0, abs=0.2)
    assert last.deviation_m == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("form", "track", "kind", "height_m"),
    [("adsb", "3C6444", "manned", 90.0), ("ais", "211234560", "vessel", nan), ("cot", "X1", "ground", 90.0)],
)
def test_command_is_received_as_traffic(form: str, track: str, kind: str, height_m: float) -> None:
    port, fixes, reasons = free_ports(), list[TargetFix](), list[str]()
    at = f"udp://127.0.0.1:{port}"
    settings: MavlinkTracks | CotTracks = MavlinkTracks(kind="mavlink", at=at)
    if form == "cot":
        settings = CotTracks(kind="cot", at=at, geoid_m=formats.GEOID_M)
    options = ("--target", "straight", "--speed", "20", "--rate", "20", "--height", "90", "--name", "X1")

    async def story() -> None:
        intake = intake_of("traffic", settings, OwnTracks())
        own = frozenset({1}), OwnTracks()
        receiving = keep_receiving_tracks(settings, *own, fixes.append, reasons.append, intake)
        task = asyncio.create_task(receiving)
        with running(*options, "--send", form, "--to", at):
            await until(lambda: len(fixes) >= 10)
        task.cancel()

    asyncio.run(story())
    assert {(fix.track, fix.kind) for fix in fixes} == {(track, kind)}
    assert fixes[-1].north_m_s == pytest.approx(20.0, abs=0.5)
    high_m = fixes[-1].altitude_amsl_m - Origin().altitude_amsl_m
    assert high_m == pytest.approx(height_m, abs=10.0, nan_ok=True)


@contextmanager
def gpsd() -> Iterator[int]:
    """A fake gpsd of 50 reports a second; its port."""
    port, stops = free_ports(), list[int]()
    server = GpsdServer("127.0.0.1", port)
    made = reports(motion("walker"), Origin(), Errors(rate_hz=50.0))
    thread = threading.Thread(target=send, args=(made, formats.tpv(0.0), server, stops))
    thread.start()
    try:
        yield port
    finally:
        stops.append(signal.SIGINT)
        thread.join()


def connected(port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), timeout=WAIT_S)


def test_gpsd_reports_to_those_that_watch() -> None:
    with gpsd() as port, closing(connected(port)) as client, closing(client.makefile("rwb")) as lines:
        answers = [json.loads(lines.readline())]
        lines.write(b'?WATCH={"enable":true,"json":true};\n')
        lines.flush()
        answers += [json.loads(lines.readline()) for _ in range(5)]
        assert [each["class"] for each in answers] == ["VERSION", "DEVICES", "WATCH", "TPV", "TPV", "TPV"]
        assert answers[1]["devices"][0]["path"] == answers[3]["device"] == formats.DEVICE
        lines.write(b'?WATCH={"enable":false};?DEVICES;\n?WATCH=junk;?POLL;\n')
        lines.flush()
        classes: list[str] = []
        while len(classes) < 5:
            kind = json.loads(lines.readline())["class"]
            classes += [kind] if kind != "TPV" else []
        assert classes == ["DEVICES", "WATCH", "DEVICES", "ERROR", "ERROR"]


def test_gpsd_outlives_its_clients() -> None:
    """Those that leave, ask without end, do not read, or are too many."""
    with gpsd() as port:
        for request in (b"", b"?WATCH;", b"x" * (ASKED_MAX + 10)):
            with closing(connected(port)) as client:
                client.sendall(request)
        silent = [connected(port) for _ in range(CLIENTS_MAX + 5)]
        for client in silent:
            client.close()
        test_client = connected(port)
        with closing(test_client), closing(test_client.makefile("rb")) as lines:
            assert json.loads(lines.readline())["class"] == "VERSION"
