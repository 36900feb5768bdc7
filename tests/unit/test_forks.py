"""`--forks`: what copies of the process report is the report; what none of them reports has failed."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
CONFTEST = """\
from tests.support.forks import Forks
def pytest_configure(config):
    config.pluginmanager.register(Forks(2))
"""
FILES = {
    "test_good.py": "def test_good(tmp_path): assert tmp_path.is_dir()",
    "test_bad.py": "def test_bad(): print('a word'); assert 1 == 2",
    "test_ends.py": "import os\ndef test_ends(): os._exit(3)\ndef test_after(): pass",
}


def run(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pytest", "-c", os.devnull, "--rootdir", str(folder), *options]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTEST_ADDOPTS": ""}
    return subprocess.run(
        [*command, "-p", "no:xdist", str(folder)],
        capture_output=True,
        text=True,
        env=environment,
        cwd=folder,
        check=False,
    )


def test_each_file_is_run_in_a_copy_and_reported(tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text(CONFTEST)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    done = run(tmp_path)
    assert done.returncode == 1, done.stderr
    assert "3 failed, 1 passed" in done.stdout
    assert "a word" in done.stdout, "what a failed test has printed"
    assert done.stdout.count("its process ended before it did") >= 2
    for name in ("test_bad", "test_ends", "test_after"):
        assert f"::{name}" in done.stdout
