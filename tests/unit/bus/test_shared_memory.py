"""Bundles between stations on one machine: whole, in order, of a running station of this user."""

import os
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.bus.bundles import BUNDLE_MAX
from gcs.bus.settings import Endpoint
from gcs.bus.shared_memory import (
    FILE_BYTES,
    PAGE,
    PREFIX,
    SLOT_BYTES,
    SLOTS,
    BundleReader,
    Writer,
    shared_file,
)
from gcs.model.errors import LinkError

WRITES = """
import sys
from pathlib import Path
from gcs.bus.shared_memory import Writer
writer = Writer(Path(sys.argv[1]))
writer.put(sys.argv[2].encode())
print("written", flush=True)
sys.stdin.read()
"""


@contextmanager
def written(file: Path) -> Iterator[Writer]:
    writer = Writer(file)
    try:
        yield writer
    finally:
        writer.close()


@given(turns=st.lists(st.lists(st.binary(max_size=60), max_size=SLOTS - 1), max_size=12))
def test_a_reader_takes_each_bundle_once_and_in_order(
    turns: list[list[bytes]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    file = tmp_path_factory.mktemp("bus") / "north"
    with written(file) as writer:
        writer.put(b"before the reader")
        reader = BundleReader(file)
        for bundles in turns:
            for bundle in bundles:
                writer.put(bundle)
            assert list(reader.newest()) == bundles
        assert list(reader.newest()) == []


def test_a_bundle_of_the_greatest_length_is_whole(tmp_path: Path) -> None:
    with written(tmp_path / "north") as writer:
        reader = BundleReader(tmp_path / "north")
        for _ in range(2 * SLOTS):
            bundle = os.urandom(BUNDLE_MAX)
            writer.put(bundle)
            assert list(reader.newest()) == [bundle]


@pytest.mark.parametrize("count", [SLOTS, SLOTS + 1, 5 * SLOTS])
def test_a_slow_reader_takes_the_newest(count: int, tmp_path: Path) -> None:
    with written(tmp_path / "north") as writer:
        reader = BundleReader(tmp_path / "north")
        sent = [number.to_bytes(2) for number in range(count)]
        for bundle in sent:
            writer.put(bundle)
        assert list(reader.newest()) == sent[1 - SLOTS :]


def test_all_stations_of_a_machine_read_one(tmp_path: Path) -> None:
    with written(tmp_path / "north") as writer:
        readers = [BundleReader(tmp_path / "north") for _ in range(3)]
        writer.put(b"1")
        assert [list(reader.newest()) for reader in readers] == [[b"1"]] * 3


@pytest.mark.parametrize("at", [0, PAGE + SLOT_BYTES, PAGE + SLOT_BYTES + 8, PAGE + SLOT_BYTES + 16])
def test_what_is_overwritten_meanwhile_is_dropped(at: int, tmp_path: Path) -> None:
    file = tmp_path / "north"
    with written(file) as writer:
        reader = BundleReader(file)
        writer.put(b"first")
        with file.open("r+b") as damaged:  # number of the newest; number, length or bytes of the bundle
            damaged.seek(at)
            damaged.write(struct.pack("<I", 0xFFFFFFFF))
        assert list(reader.newest()) == []
        writer.put(b"second")
        writer.put(b"third")
        assert list(reader.newest())[-1:] == [b"third"]


def test_a_killed_station_is_not_read_and_a_restarted_one_is(tmp_path: Path) -> None:
    file = tmp_path / "north"
    for bundle in ("first", "second"):
        command = [sys.executable, "-c", WRITES, str(file), bundle]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == b"written\n"
            assert list(BundleReader(file).newest()) == []
            with pytest.raises(LinkError, match="another station writes it"):
                Writer(file)
            process.kill()
        with pytest.raises(LinkError, match="no station writes it"):
            BundleReader(file)


def test_files_of_killed_stations_are_removed_and_others_kept(tmp_path: Path) -> None:
    killed, runs, foreign = (tmp_path / f"{PREFIX}{name}" for name in ("killed", "runs", "foreign"))
    killed.write_bytes(bytes(FILE_BYTES))
    other = tmp_path / "notes"
    other.write_text("of another program")
    foreign.symlink_to(other)
    with written(runs) as writer:
        reader = BundleReader(runs)
        with written(tmp_path / f"{PREFIX}new"):
            assert not killed.exists()
            writer.put(b"1")
            assert list(reader.newest()) == [b"1"]
            assert other.read_text() == "of another program"


def test_a_station_that_ends_leaves_no_file(tmp_path: Path) -> None:
    with written(tmp_path / "north") as writer:
        reader = BundleReader(tmp_path / "north")
        writer.put(b"last")
    assert not (tmp_path / "north").exists()
    assert list(reader.newest()) == [b"last"]
    with pytest.raises(LinkError, match="No such file"):
        BundleReader(tmp_path / "north")


def test_a_file_of_another_form_is_not_read(tmp_path: Path) -> None:
    file = tmp_path / "north"
    for content in (b"", b"short", bytes(FILE_BYTES + 1)):
        file.write_bytes(content)
        with pytest.raises(LinkError, match="no station writes it"):
            BundleReader(file)
    file.unlink()
    file.symlink_to(tmp_path / "elsewhere")
    for refused in (BundleReader, Writer):
        with pytest.raises(LinkError, match="symbolic links"):
            refused(file)


def test_a_file_of_another_user_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "north"
    with written(file) as writer:
        assert file.stat().st_mode & 0o777 == 0o600
        monkeypatch.setattr(os, "geteuid", lambda: file.stat().st_uid + 1)
        for refused in (BundleReader, Writer):
            with pytest.raises(LinkError, match="belongs to another user"):
                refused(file)
        writer.put(b"")


def test_each_endpoint_has_a_file_of_its_own() -> None:
    endpoints = [Endpoint(host=host, port=port) for host in ("127.0.0.1", "::1") for port in (7447, 7448)]
    assert len({shared_file(one) for one in endpoints}) == len(endpoints)
    assert all(shared_file(one).parent.is_dir() for one in endpoints)
