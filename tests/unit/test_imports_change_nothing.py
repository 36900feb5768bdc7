"""What a program needs changed in other packages it changes where it starts, not an import."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.soak
@pytest.mark.long
def test_no_import_changes_another_package_or_the_process() -> None:
    command = [sys.executable, "-m", "tests.support.every_module"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == []
