"""Two hundred broken or hostile files of drawn shows, and a process that reads them and counts memory."""

import io
import json
import random
import sys
import zipfile
from collections.abc import Callable, Iterator
from copy import deepcopy
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from gcs.model.errors import DrawingError
from gcs.shows.formats import read_drawing
from tests.support.drawing_files import flight, light, skyc, zipped

Made: TypeAlias = tuple[str, str, Callable[[], bytes]]
"""What is broken, the file's name, and what makes its bytes."""

GOOD = {
    **flight([0, [0, 0, 0], []], [5, [1, 2, 3], [[0, 0, 1], [0, 1, 2]]], [9, [4, 4, 4], []], takeoffTime=2),
    "home": [0, 0, 0],
    "name": "drone",
    "lights": light(4, 9, 8, 7, 50, 8, 1, 2, 3, 50, 0),
    "yawControl": {"version": 1, "setpoints": [[0, 0], [5, 90]]},
}
SHOW = {
    "environment": {"type": "outdoor", "location": {"origin": [470000000, 85000000], "orientation": 0}},
    "settings": {
        "cues": {"version": 1, "items": [{"time": 1, "name": "a"}]},
        "validation": {"minDistance": 2},
        "geofence": {"version": 1, "polygons": [{"isInclusion": True, "points": [[1, 1], [1, -1], [-1, 0]]}]},
    },
    "meta": {"title": "t", "segments": {"show": [1, 8]}},
}
_DRONE = ("swarm", "drones", 0, "settings")
_POINTS = (*_DRONE, "trajectory", "points")
CHECKED: list[tuple[str | int, ...]] = [
    ("version",),
    ("swarm",),
    ("swarm", "drones"),
    ("swarm", "drones", 0),
    _DRONE,
    (*_DRONE, "trajectory"),
    (*_DRONE, "trajectory", "version"),
    (*_DRONE, "trajectory", "takeoffTime"),
    _POINTS,
    (*_POINTS, 0),
    (*_POINTS, 1, 0),
    (*_POINTS, 1, 1),
    (*_POINTS, 1, 1, 2),
    (*_POINTS, 1, 2, 0),
    (*_POINTS, 1, 2, 1, 0),
    (*_DRONE, "home"),
    (*_DRONE, "name"),
    (*_DRONE, "lights"),
    (*_DRONE, "lights", "version"),
    (*_DRONE, "lights", "data"),
    (*_DRONE, "yawControl", "setpoints", 1, 0),
    ("environment", "location"),
    ("environment", "location", "origin"),
    ("environment", "location", "orientation"),
    ("settings", "cues", "items", 0, "time"),
    ("settings", "validation", "minDistance"),
    ("settings", "geofence", "polygons", 0, "points", 1),
    ("meta", "title"),
    ("meta", "segments", "show", 1),
]
"""Values of a show that the reader uses."""


def made() -> Iterator[Made]:
    """Yield all broken files."""
    rng = random.Random(18)
    yield from _wrong_values(rng)
    yield from _broken_bytes(rng)
    yield from _bombs()
    yield from _code()
    yield from _tables()


def _changed(path: tuple[str | int, ...], value: object) -> bytes:
    entries = skyc(deepcopy(GOOD), **deepcopy(SHOW))
    here: Any = entries["show.json"]
    for key in path[:-1]:
        here = here[key]
    here[path[-1]] = value
    return zipped({"show.json": json.dumps(entries["show.json"])})


def _wrong_values(rng: random.Random) -> Iterator[Made]:
    """Put NaN, infinity, another type, or a number beyond all bounds where the reader needs a value."""
    wrong = [float("nan"), float("inf"), True, 1e300, -1e30, 10**400, {"$ref": "./none.json"}, [[[]]] * 3]
    for path in CHECKED:
        for value in rng.sample(wrong, 4):
            yield f"{path} = {str(value)[:20]}", "a.skyc", partial(_changed, path, value)
    yield "times that go back", "a.skyc", lambda: _changed((*_POINTS, 2, 0), 4)
    yield "a time twice", "a.skyc", lambda: _changed((*_POINTS, 2, 0), 5)
    yield "no point", "a.skyc", lambda: _changed(_POINTS, [])
    yield "nine control points", "a.skyc", lambda: _changed((*_POINTS, 1, 2), [[0, 0, 0]] * 9)
    yield "no drone", "a.skyc", lambda: _changed(("swarm", "drones"), [])
    yield "5,000 drones", "a.skyc", lambda: _changed(("swarm", "drones"), [{}] * 5000)
    yield "60,000 points", "a.skyc", lambda: _changed(_POINTS, [0] * 60_000)
    yield "a reference to itself", "a.skyc", lambda: _changed(("swarm",), {"$ref": "show.json"})
    yield "a reference into a file", "a.skyc", lambda: _changed(("swarm",), {"$ref": "show.json#/swarm"})
    yield (
        "a reference out of the archive",
        "a.skyc",
        lambda: _changed(("swarm",), {"$ref": "../../etc/passwd"}),
    )


def _broken_bytes(rng: random.Random) -> Iterator[Made]:
    good = zipped(skyc(GOOD, **SHOW))
    for _ in range(30):
        length = rng.randrange(len(good))
        yield f"cut off at {length}", "a.skyc", partial(bytes, good[:length])
    compressed = range(39 + 20, 39 + 200)  # within show.json, past its header of 39 bytes
    for at in rng.sample(compressed, 20):
        changed = good[:at] + bytes((good[at] ^ rng.randrange(1, 256),)) + good[at + 1 :]
        yield f"byte {at} changed", "a.skyc", partial(bytes, changed)
    yield "nothing", "a.skyc", lambda: b""
    yield "no archive", "a.skyc", lambda: rng.randbytes(4000)
    yield "no show.json", "a.skyc", lambda: zipped({"other.json": "{}"})
    yield "not UTF-8", "a.skyc", lambda: zipped({"show.json": b'{"a": "\xff\xfe"}'})
    yield "no JSON", "a.skyc", lambda: zipped({"show.json": "{'version': 1}"})
    yield "only a number", "a.skyc", lambda: zipped({"show.json": "1"})
    yield "encrypted", "a.skyc", lambda: _flagged(good)


def _flagged(data: bytes) -> bytes:
    """Return the archive with the flag of encryption on its entries."""
    flagged = bytearray(data)
    for signature, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        flagged[data.index(signature) + offset] |= 1
    return bytes(flagged)


def _bombs() -> Iterator[Made]:
    """Yield files that would need much memory or time."""
    yield "1 GB of zeros", "a.skyc", lambda: _filled(b"\0" * 2**20, 1024)
    yield "24 MB of zeros", "a.skyc", lambda: _filled(b"\0" * 2**20, 24)
    yield "a size that is not true", "a.skyc", _lying
    yield "20,000 entries", "a.skyc", lambda: zipped({str(at): "" for at in range(20_000)})
    yield "lists in lists", "a.skyc", lambda: _stored(b"[" * 4_000_000)
    yield "objects in objects", "a.skyc", lambda: _stored(b'{"a":' * 400_000)
    yield "millions of lists", "a.skyc", lambda: _stored(b"[" + b"[]," * 7_000_000 + b"[]]")
    yield "millions of objects", "a.skyc", lambda: _stored(b"[" + b"{}," * 7_000_000 + b"{}]")
    yield "millions of numbers", "a.skyc", lambda: _stored(b"[" + b"0," * 11_000_000 + b"0]")
    yield "many short texts", "a.skyc", lambda: _stored(_texts())
    yield "a long text", "a.skyc", lambda: _stored(b'"' + b"a" * 20_000_000 + b'"')
    yield "a number of a million digits", "a.skyc", lambda: _stored(b"9" * 1_000_000)
    yield "the same 20 MB again and again", "a.skyc", _again
    yield "40 megabytes of nothing", "a.skyc", lambda: b"\0" * 40_000_000
    yield "70 megabytes of nothing", "a.skyc", lambda: b"\0" * 70_000_000


def _texts() -> bytes:
    return b"[" + b",".join(b'"%x"' % number for number in range(1_400_000)) + b"]"


def _stored(content: bytes) -> bytes:
    return zipped({"show.json": content}, zipfile.ZIP_STORED)


def _filled(block: bytes, blocks: int) -> bytes:
    content = io.BytesIO()
    with (
        zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("show.json", "w") as entry,
    ):
        for _ in range(blocks):
            entry.write(block)
    return content.getvalue()


def _lying() -> bytes:
    """Return an archive of 100 MB that its entry calls 1 kB."""
    data = bytearray(_filled(b"\0" * 2**20, 100))
    at = data.index(b"PK\x01\x02")
    data[at + 24 : at + 28] = (1024).to_bytes(4, "little")
    return bytes(data)


def _again() -> bytes:
    """Return a show of 1,000 drones; the trajectory of all is one entry of 5 MB."""
    points = ",".join(f"[{at},[0,0,{at % 9}],[]]" for at in range(1, 200_000))
    drone = {"trajectory": {"$ref": "./one.json"}}
    trajectory = '{"version":1,"points":[[0,[0,0,0],[]]]}' + " " * 5_000_000 + "\n" + " " * len(points)
    return zipped({**skyc(*[drone] * 1000), "one.json": trajectory}, zipfile.ZIP_STORED)


def _code() -> Iterator[Made]:
    """Yield light programs that do not end, or are none."""
    programs = {
        "loops in loops": (12, 255, 12, 255, 12, 255, 12, 255, 7, 0, 13, 13, 13, 13),
        "a loop without time": (12, 0, 1, 13),
        "loops too deep": (12, 2) * 9,
        "the end of no loop": (13,),
        "an unknown command": (99,),
        "a jump": (18, 0),
        "a command without its colour": (4, 1),
        "a duration of many bytes": (2, *[255] * 9, 1),
    }
    for what, code in programs.items():
        yield what, "a.skyc", partial(_changed, (*_DRONE, "lights"), light(*code))
    yield "no base64", "a.skyc", lambda: _changed((*_DRONE, "lights", "data"), "*" * 40)
    yield "a megabyte of code", "a.skyc", lambda: _changed((*_DRONE, "lights", "data"), "A" * 1_000_000)


def _tables() -> Iterator[Made]:
    """Yield broken CSV files."""
    tables = {
        "no row": "",
        "a row of names only": "Time_msec,X,Y,Z,R,G,B\n",
        "words": "a,b,c,d\ne,f,g,h\n",
        "three columns": "0,0,0\n",
        "rows of two lengths": "0,0,0,0\n1,0,0\n",
        "NaN": "0,0,0,nan\n",
        "infinity": "0,0,inf,0\n",
        "a time before the first": "5,0,0,0\n4,0,0,0\n",
        "a colour of 300": "0,0,0,0,300,0,0\n",
        "a place too far away": "0,1e9,0,0\n",
        "a duration of 0": "0" + ",1" * 32 + "\n",
        "a duration of NaN": "nan" + ",1" * 32 + "\n",
        "polynomials that grow too far": "100" + ",1" * 32 + "\n",
        "a line of 3 MB": "1," * 1_500_000,
        "millions of rows": "0,0,0,0\n" * 2_500_000,
        "bytes that are no text": b"\xff\xfe\x00",
    }
    for what, text in tables.items():
        yield what, "a.zip", partial(zipped, {"one.csv": text})
    yield "no file in the zip", "a.zip", lambda: zipped({"readme.txt": "x"})
    yield "2,000 files", "a.zip", lambda: zipped({f"{at}.csv": "0,0,0,0\n" for at in range(2000)})
    yield "polynomials without a row", "a.csv", lambda: b"duration\n"
    yield "another kind of file", "a.exe", lambda: b"MZ"


def main() -> None:
    """Read the file of each path that comes in on stdin, and print its error, or null, and the peak in MB."""
    for line in sys.stdin:
        place = problem = None
        try:
            read_drawing(Path(line.strip()))
        except DrawingError as error:
            place, problem = error.place, error.problem
        status = Path("/proc/self/status").read_text()  # getrusage also counts what the parent had
        peak_mb = int(status.split("VmHWM:")[1].split()[0]) / 1024
        print(json.dumps({"place": place, "problem": problem, "peak_mb": peak_mb}), flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
