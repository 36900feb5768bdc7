"""A number is added in a copy of the tree: everything that shows numbers has it, from two lines."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[3]
TABLE, FLIGHT = "gcs/model/vehicle_columns.py", "gcs/flight/monitors/snapshots.py"
TYPES = "api/console/src/schemas/schema.ts"
SOURCES = ("gcs", "api", "sim")

ROW = """\
    wind_m_s: Annotated[
        Array,
        Column(
            "m/s",
            AUTOPILOT,
            "Wind",
            api="wind_m_s",
            label="Wind",
            record="wind_m_s",
            bus=ByteSteps(0.5, least=-10.0),
            metric="gcs_vehicle_wind_meters_per_second",
        ),
    ]
"""
MEASURED = '        "wind_m_s": np.linspace(-3.0, 4.5, len(fleet.ids)),\n'


def insert(file: Path, line: str, before: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert text.count(before) == 1
    file.write_text(text.replace(before, line + before), encoding="utf-8")


def touched(tree: Path) -> set[str]:
    """Files of the copy that differ from the original, or are new."""
    files = [file for name in SOURCES for file in (tree / name).rglob("*") if file.is_file()]
    names = [file.relative_to(tree) for file in files if "__pycache__" not in file.parts]
    return {
        str(name)
        for name in names
        if not (ROOT / name).is_file() or (ROOT / name).read_bytes() != (tree / name).read_bytes()
    }


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy with one more number."""
    tree = tmp_path_factory.mktemp("tree")
    ignored = shutil.ignore_patterns("__pycache__", "node_modules", "dist")
    for name in SOURCES:
        shutil.copytree(ROOT / name, tree / name, symlinks=True, ignore=ignored)
    insert(tree / TABLE, ROW, before="    fix_type: Annotated[")
    insert(tree / FLIGHT, MEASURED, before='        "fix_type": telemetry.fix_type,\n')
    return tree


@pytest.fixture(scope="module")
def found(tree: Path) -> Any:
    """What a program prints that runs with the copy."""
    paths = os.pathsep.join([str(tree), str(ROOT)])  # gcs of the copy, tests of the original
    command = [sys.executable, "-P", "-m", "tests.support.number_everywhere", "wind_m_s"]
    return json.loads(subprocess.check_output(command, env={**os.environ, "PYTHONPATH": paths}, text=True))


@pytest.mark.soak
@pytest.mark.long
def test_a_new_number_is_shown_everywhere(found: Any) -> None:
    described = found["document"]["components"]["schemas"]["Vehicle"]["properties"]["wind_m_s"]
    assert described["description"] == "Wind. Measured by the autopilot."
    places = ("view", "frame", "REST", "record", "metrics", "bus")
    assert found["places"] == {place: [-3.0, 4.5] for place in places}


@pytest.mark.soak
def test_a_new_number_takes_three_files_at_most(tree: Path, found: Any) -> None:
    console = tree / "api" / "console"
    (console / "node_modules").symlink_to(ROOT / "api" / "console" / "node_modules")
    path = os.pathsep.join([str(ROOT / ".venv-node" / "bin"), os.environ["PATH"]])
    command = ["npm", "run", "--silent", "schema", "--", "--output", str(tree / TYPES)]  # as `make schema`
    document, environment = json.dumps(found["document"]), {**os.environ, "PATH": path}
    subprocess.run(command, cwd=console, env=environment, input=document, check=True, text=True)
    (console / "node_modules").unlink()
    assert touched(tree) == {TABLE, FLIGHT, TYPES}
    types = (tree / TYPES).read_text(encoding="utf-8")
    assert '| "wind_m_s"' in types  # of a frame's columns
    assert "wind_m_s: number | null;" in types
