"""`gcs replay` in a process of its own."""

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replay(record: Path | str, *options: str, folder: Path | None = None) -> Iterator[str]:
    """The API's address until the block ends; it begins in `folder`, and then ends as it was asked to."""
    command = [sys.executable, "-m", "gcs", "replay", str(record), "--port", "0", *options]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        address = re.search(r"http://\S+:\d+", process.stdout.readline())
        assert address is not None
        yield address[0]
    finally:
        process.terminate()
        process.communicate(timeout=120)
    assert process.returncode == 0
