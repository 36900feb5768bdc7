"""`gcs replay` in a separate process."""

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replay(record: Path | str, *options: str, folder: Path | None = None) -> Iterator[str]:
    """Run a replay in `folder` until the block ends, then end it by request. Yields the API's address."""
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
