"""A folder of records has one service; the lock ends with its process, and prevents no flight."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from gcs.model.errors import RefusedError
from gcs.service.folder_lock import in_turn, owned

HOLDS = """
import sys, time
from pathlib import Path
from gcs.service.folder_lock import owned
with owned(Path(sys.argv[1])):
    print("owned", flush=True)
    time.sleep(600)
"""


@pytest.fixture
def other(tmp_path: Path) -> "Iterator[subprocess.Popen[str]]":
    """Another process that owns the folder."""
    command = [sys.executable, "-c", HOLDS, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            with closing(process.stdout):
                assert process.stdout.readline() == "owned\n"
                yield process
        finally:
            process.kill()


def test_second_service_is_refused_and_names_the_first(
    tmp_path: Path, other: "subprocess.Popen[str]"
) -> None:
    before = sorted(tmp_path.iterdir())
    named = f"pid {other.pid} on .*{tmp_path}.*another `record:`"
    with pytest.raises(RefusedError, match=named), owned(tmp_path):
        pass
    assert sorted(tmp_path.iterdir()) == before
    other.send_signal(signal.SIGKILL)
    other.wait()
    with owned(tmp_path):
        assert f"pid {os.getpid()} " in (tmp_path / ".lock").read_text()


def test_stopped_service_keeps_its_folder(tmp_path: Path, other: "subprocess.Popen[str]") -> None:
    other.send_signal(signal.SIGSTOP)
    with pytest.raises(RefusedError), owned(tmp_path):
        pass


def test_folder_that_cannot_be_made_prevents_nothing(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    with owned(tmp_path / "file" / "runs"):
        pass
    assert [record.message for record in caplog.records] == ["folder_not_locked"]


def test_shared_folder_is_written_in_turn(tmp_path: Path) -> None:
    writes = threading.Event()

    def write() -> None:
        with in_turn(tmp_path):
            writes.set()

    with in_turn(tmp_path):
        second = threading.Thread(target=write)
        second.start()
        assert not writes.wait(0.2)
    second.join()
    assert writes.is_set()
    assert list(tmp_path.iterdir()) == []
