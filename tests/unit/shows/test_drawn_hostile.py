"""Broken and hostile files of drawn shows: a clear error each, in little memory."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from gcs.model.errors import DrawingError
from gcs.shows.formats import parse_drawing
from tests.support.broken_drawings import made
from tests.support.drawing_files import HOVER, flight, light, skyc, zipped

MEMORY_MAX_MB = 300


@pytest.mark.soak
def test_two_hundred_broken_files_have_a_clear_error_each(tmp_path: Path) -> None:
    """Each names file and place and says what is wrong; the process that reads them all stays small."""
    command = [sys.executable, "-m", "tests.support.broken_drawings"]
    count = 0
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as reader:
        assert reader.stdin is not None
        assert reader.stdout is not None
        for what, file, make in made():
            path = tmp_path / file
            path.write_bytes(make())
            print(path, file=reader.stdin, flush=True)
            found = json.loads(reader.stdout.readline())
            assert found["place"] is not None, f"{what}: read without an error"
            assert found["place"].startswith(file), what
            assert 0 < len(found["place"]) + len(found["problem"]) < 600, what
            assert found["peak_mb"] <= MEMORY_MAX_MB, what
            count += 1
        reader.stdin.close()
    assert count >= 200


@pytest.mark.parametrize(
    ("drone", "problem"),
    [
        (
            flight([0, [0, 0, 0], []], [5, [0, 0, "up"], []]),
            r"settings\.trajectory\.points\[1\]: \[5, \[0, 0, 'up'\], \[\]\]: \[time, \[x, y, z\], ",
        ),
        (flight([0, [0, 0, 0]], [5, [0, 0, 1]], [4, [0, 0, 2]]), r"points\[2\]: time 4 s: .* after the 5 s"),
        (flight([0, [0, 0, 0]], [5, [0, 0, 1e5]]), r"points: a coordinate is not finite, or beyond 20000 m"),
        ({"trajectory": {"points": []}}, r"settings\.trajectory: 'version' is missing"),
        ({"trajectory": {"version": 7}}, r"settings\.trajectory\.version: 7: 0 or 1 or 2 is needed"),
        ({**HOVER, "lights": light(4, 1, 2)}, r"settings\.lights\.data: byte 3: the program ends within"),
        ({**HOVER, "lights": light(12, 0, 1, 13)}, r"lights\.data: byte \d: more than 50000 commands"),
        ({**HOVER, "lights": light(18, 0)}, r"byte 0: jumps: not known to this station"),
        (
            {**HOVER, "yawControl": {"version": 1, "setpoints": [[1, 0], [1, 9]]}},
            r"setpoints\[1\]\[0\]: 1: a number from 1 to 7200",
        ),
    ],
)
def test_an_error_names_the_place_in_the_file(drone: dict[str, object], problem: str) -> None:
    with pytest.raises(DrawingError, match=r"^a\.skyc: show\.json: swarm\.drones\[0\]\.") as raised:
        parse_drawing(zipped(skyc(drone)), "a.skyc")
    assert raised.match(problem)


def test_an_error_in_an_asset_names_the_asset() -> None:
    entries = skyc({"trajectory": {"$ref": "./drones/1.json"}})
    entries["drones/1.json"] = '{"version": 1, "points": [[0, [0, 0, NaN]]]}'
    expected = r"^a\.skyc: drones/1\.json: not JSON: expected value at line 1 column 38"
    with pytest.raises(DrawingError, match=expected):
        parse_drawing(zipped(entries), "a.skyc")


def test_a_bomb_is_refused_before_it_is_unpacked() -> None:
    with pytest.raises(DrawingError, match=r"show\.json: \d+ bytes expand to 20000000: at most 200 times"):
        parse_drawing(zipped({"show.json": " " * 20_000_000}), "a.skyc")
