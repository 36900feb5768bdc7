"""docs/invariants.md lists every place where bytes come in: sockets, devices, and what expands bytes."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs.links import intake
from gcs.links.rtk import CORRECTIONS
from gcs.links.targets.mavlink import TELEMETRY
from gcs.links.targets.receive import TARGETS
from gcs.shows.timecode.receiver import MIDI, SAMPLE_BYTES

ROOT = Path(__file__).parents[2]
OPENS = {
    *("socket.socket", "socket.socketpair", "socket.create_connection", "socket.create_server"),
    *("socket.fromfd", "serial.Serial", "serial.serial_for_url", "zenoh.open", "httpx.Client"),
    *("asyncio.open_connection", "asyncio.open_unix_connection", "asyncio.start_server"),
    *("asyncio.start_unix_server", "create_datagram_endpoint", "create_server", "create_connection"),
    *("connect_read_pipe", "connect_accepted_socket", "urlopen", "websockets.connect", "add_reader"),
    *("zipfile.ZipFile", "tarfile.open", "zlib.decompress", "zlib.decompressobj", "gzip.open"),
    *("gzip.decompress", "bz2.open", "bz2.decompress", "lzma.open", "lzma.decompress"),
    *("zstandard.decompress", "zstandard.ZstdDecompressor", "lz4.decompress", "uvicorn.Config"),
    "sqlite3.connect",
}
LOCAL = {
    "gcs/cli/service/process.py": "sends to the supervisor",
    "gcs/cli/timecode.py": "sends timecode",
    "gcs/cli/service/serve.py": "tries whether a port is free",
    "gcs/cli/service/supervisor.py": "reads its own child",
    "gcs/shows/formats/csv_show.py": "writes a zip",
    "gcs/shows/formats/skybrush_writer.py": "writes a zip",
    "gcs/recording/audit_database.py": "the record, in a folder of our own",
    "gcs/cli/kill/plan.py": "the record, in a folder of our own",
}
"""Files that open something, and read no stranger's bytes from it."""


def dotted(function: ast.expr) -> str:
    if isinstance(function, ast.Attribute):
        return f"{dotted(function.value)}.{function.attr}"
    return function.id if isinstance(function, ast.Name) else ""


def opening(source: str) -> Iterator[str]:
    """Calls in a source that open an input."""
    if not any(name in source for name in OPENS):  # not worth parsing
        return
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call):
            for name in map(dotted, (node.func, *node.args)):  # or another thread calls it
                yield from {name, name.rpartition(".")[2]} & OPENS


def files_that_open() -> set[str]:
    paths = [path for part in ("gcs", "api") for path in (ROOT / part).rglob("*.py")]
    inside = {path.relative_to(ROOT) for path in paths if "node_modules" not in path.parts}
    ours = {path for path in inside if path.parts[:2] not in {("gcs", "api"), ("gcs", "sim")}}
    return {str(path) for path in ours if any(opening((ROOT / path).read_text(encoding="utf-8")))}


def table() -> str:
    text = (ROOT / "docs" / "invariants.md").read_text(encoding="utf-8")
    return text.partition("## What every input may cost")[2].partition("\n## ")[0]


def test_every_place_that_opens_an_input_is_in_the_table() -> None:
    listed = set(re.findall(r"`((?:gcs|api)/[a-z_/0-9]+\.py)`", table()))
    found = files_that_open()
    assert found - LOCAL.keys() - listed == set(), "say what this input may cost, and bound it"
    assert {path for path in listed if not (ROOT / path).is_file()} == set()
    assert LOCAL.keys() - found == set(), "these open nothing any more"
    assert LOCAL.keys() & listed == set()


@pytest.mark.parametrize(
    "source",
    [
        "import socket\nwith socket.socket() as one: ...",
        "loop.create_datagram_endpoint(x)",
        "asyncio.get_running_loop().add_reader(1, f)",
        "zipfile.ZipFile(data)",
        "loop.run_in_executor(None, zenoh.open, config)",
    ],
)
def test_a_new_input_is_found(source: str) -> None:
    assert list(opening(source))


@pytest.mark.parametrize(
    ("name", "bound"),
    [
        ("corrections for RTK", CORRECTIONS),
        ("a target's MAVLink", TELEMETRY),
        ("timecode over RTP or UDP, a MIDI port", MIDI),
        ("timecode as sound", intake.sound(48_000.0, SAMPLE_BYTES)),
        ("further ground stations", intake.FORWARDED),
        ("sources of targets", TARGETS),
        ("vehicles over UDP", intake.of_vehicles(0)),
    ],
)
def test_bounds_in_the_table_are_those_of_the_code(name: str, bound: intake.Bound) -> None:
    row = next(line for line in table().splitlines() if line.startswith(f"| {name}"))
    assert f"{bound.bytes_per_s / 1000:g} kB/s" in row
    if bound.messages_per_s < float("inf"):
        assert f"{bound.messages_per_s:g} messages/s" in row


def test_every_test_that_is_named_in_the_table_exists() -> None:
    tests = re.findall(r"`(tests/[a-z_/]+\.py)`", table())
    assert tests
    assert [name for name in tests if not (ROOT / name).is_file()] == []
