"""Drawings as programs write them: imported, checked, exported, read again, and flown by `gcs simulate`.

Seeded. A row of Crazyswarm's polynomials is described in `gcs.shows.formats.polynomials`.
"""

import json
import re
import tempfile
from base64 import b64encode
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import partial
from io import StringIO
from itertools import pairwise
from math import comb
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gcs.cli.main import main
from gcs.shows import load
from gcs.shows.drawn import DrawnShow, Trajectory
from gcs.shows.formats import parse_drawing
from gcs.shows.formats.files import EXPORTED
from gcs.shows.formats.samples import NWU
from gcs.simulation.batch import Run, run_once
from gcs.simulation.scenario import Scenario
from tests.support.drawing_files import flight, light, skyc, zipped
from tests.support.drawn_shows import SHAPES, drawn_show

NAMES = ",".join(["duration", *(f"{axis}^{power}" for axis in ("x", "y", "z", "yaw") for power in range(8))])
PLACE = "-33.8,151.2,20,0"


class Drawing(NamedTuple):
    """A file of another program."""

    kind: str
    name: str  # with the suffix
    make: Callable[[], bytes]


# five generators


def blender() -> dict[str, Any]:
    """Skybrush Studio for Blender: references, whole numbers of 1e-7 degrees, cubic curves, lights, cues."""
    entries: dict[str, Any] = skyc(
        *(
            {
                "name": f"Drone {row + 1}",
                "home": [0.0, 5.0 * row, 0.0],
                "landAt": [0.0, 5.0 * row, 0.0],
                "trajectory": {"$ref": f"./drones/Drone {row + 1}/trajectory.json#"},
                "lights": {"$ref": f"./drones/Drone {row + 1}/lights.json#"},
            }
            for row in range(3)
        ),
        settings={"cues": {"$ref": "./cues.json"}, "validation": {"maxAltitude": 150, "minDistance": 3}},
        environment={
            "type": "outdoor",
            "location": {"origin": [-338567000, 1512153000, 20000], "orientation": 0},
        },
        meta={"title": "Harbour", "segments": {"takeoff": [0, 10], "show": [10, 40], "landing": [40, 60]}},
        media={"audio": {"url": "./music.mp3"}},
    )
    entries["cues.json"] = {
        "version": 1,
        "items": [{"time": 0, "name": "Takeoff"}, {"time": 20, "name": "Wall"}],
    }
    for row in range(3):
        y_m = 5.0 * row
        points = [
            [0, [0, y_m, 0], []],
            [10, [0, y_m, 10], [[0, y_m, 2], [0, y_m, 8]]],
            [40, [6, y_m, 12], [[2, y_m, 10], [5, y_m, 12]]],
            [60, [0, y_m, 0], [[6, y_m, 12], [0, y_m, 4]]],
        ]
        entries[f"drones/Drone {row + 1}/trajectory.json"] = {
            "version": 1,
            "points": points,
            "takeoffTime": 0,
        }
        entries[f"drones/Drone {row + 1}/lights.json"] = light(7, 50, 8, 255, 0, 0, 100, 10, 50, 0)
    return entries


def skyc_utils() -> dict[str, Any]:
    """AIMotionLab: degree 7, yaw as a fourth coordinate, parameters, no place on Earth, an empty media."""
    rest = [[0.0, 0.0, 5.5, 0.0]] * 3
    points = [[0.0, [0, 0, 5.5, 0], []], [20.0, [3, 0, 5.5, 90], [*rest, *[[3.0, 0.0, 5.5, 90.0]] * 3]]]
    drone = {
        "trajectory": {"$ref": "./drones/drone_0/trajectory.json#"},
        "home": [0, 0, 5.5],
        "startYaw": 0,
        "landAt": [3, 0, 5.5],
        "name": "drone_0",
        "parameters": [[1.0, "stabilizer.controller", 2]],
    }
    trajectory = {
        "version": 1,
        "points": points,
        "takeoffTime": 0.0,
        "landingTime": 20.0,
        "type": "COMPRESSED",
    }
    root = skyc(drone, environment={"type": "indoor"}, meta={"id": "a.py", "inputs": ["a.py"]}, media={})
    return {**root, "drones/drone_0/trajectory.json": trajectory}


def legacy() -> dict[str, Any]:
    """Older exporters: samples, everything in one document, no lights."""
    rows = [[at_s, 2.0 * np.sin(at_s / 9), 0.0, min(at_s, 9.0)] for at_s in range(60)]
    return skyc({"trajectory": {"version": 0, "points": rows}})


def binary() -> dict[str, Any]:
    """Samples as 32-bit floats."""
    rows = np.array([[at_s, at_s / 10, 4.0, 8.0] for at_s in np.arange(0, 40, 0.25).tolist()], "<f4")
    return skyc({"trajectory": {"version": 2, "points": b64encode(rows.tobytes()).decode()}})


def scripts() -> dict[str, Any]:
    """Scripts of single users: points without controls, a name for each, what they made up beside it."""
    drones = [
        {**flight(*([at_s, [x_m, 0, z_m]] for at_s, z_m in ((0, 0), (9, 9), (50, 9), (59, 0)))), "id": x_m}
        for x_m in (0, 4, 8)
    ]
    return skyc(*drones, settings={"fps": 4}, meta={"title": "#1 {best}"})


GENERATORS = blender, skyc_utils, legacy, binary, scripts


# polynomials, as they are in public

STYLES: Sequence[Callable[[list[str]], str]] = (
    lambda rows: "".join(f"{row},\n" for row in (NAMES, *rows)),
    lambda rows: "\n".join((NAMES, *rows)) + "\n",
    lambda rows: "".join(f"{row},\r\n" for row in (NAMES.capitalize(), *rows)),
    lambda rows: "\n\n".join((f"# made by hand\n{NAMES}", *(f"# piece\n{row}" for row in rows))),
    lambda rows: "\n".join((f'"{NAMES}"', *(f"  {row}  # piece" for row in rows))),
    lambda rows: "\ufeff" + "\n".join(rows),
)
"""A comma at the end of rows, none, other line ends, comments and empty lines, a quoted header, none."""


def polynomial_rows(trajectory: Trajectory) -> list[str]:
    """Return rows of 33 numbers: with six decimals, as in public, or six digits where these would not do."""
    rows = []
    for duration_s, over_u in zip(np.diff(trajectory.times_s), trajectory.coefficients_m, strict=True):
        over_t = np.zeros((8, 4))
        over_t[: len(over_u), :3] = over_u * NWU / duration_s ** np.arange(len(over_u))[:, None]
        written = ".6f" if duration_s <= 1.0 else ".6g"
        rows.append(",".join(format(value, written) for value in (duration_s, *over_t.T.ravel())))
    return rows


def in_pieces(trajectory: Trajectory, longest_s: float) -> Trajectory:
    """Return the same with pieces of at most so long: the binomials of u = (at + v) / count."""
    times_s, pieces = [float(trajectory.times_s[0])], []
    for (begin_s, end_s), over_u in zip(pairwise(trajectory.times_s), trajectory.coefficients_m, strict=True):
        count, powers = int(np.ceil((end_s - begin_s) / longest_s)), range(len(over_u))
        for at in range(count):
            shift = [[comb(k, j) * at ** max(k - j, 0) / count**k for k in powers] for j in powers]
            pieces.append(np.array(shift) @ over_u)
            times_s.append(begin_s + (at + 1) * (end_s - begin_s) / count)
    return Trajectory(np.array(times_s), np.stack(pieces))


SETTLES = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0] * 4, [0] * 4, [-35, -20, 35, -15], [84, 45, -84, 39],
                    [-70, -36, 70, -34], [20, 10, -20, 10]], float)  # fmt: skip
"""(8, 4) Powers of u from place and velocity at both ends, with neither acceleration nor jerk there."""


def curve(pieces: int, seed: int, size: float) -> Trajectory:
    """Return a curve through random points, from rest to rest, `size` times as large and as long."""
    rng = np.random.default_rng(seed)
    durations_s = np.ones(pieces) if seed % 2 else rng.uniform(0.9, 2.7, pieces)
    steps_m = rng.normal(0.0, (0.3, 0.3, 0.1), (pieces, 3))
    places_m = np.concatenate([np.zeros((1, 3)), np.cumsum(steps_m, axis=0)]) - (0.0, 0.0, 1.0)
    ways_m = np.zeros((pieces + 1, 3))
    ways_m[1:-1] = 0.5 * (places_m[2:] - places_m[:-2])
    ends = np.stack([places_m[:-1], ways_m[:-1], places_m[1:], ways_m[1:]], axis=1)
    ends[:, 1::2] *= durations_s[:, None, None]
    lifted_m = np.zeros((8, 3))
    lifted_m[0, 2] = -6.0 * (size - 1.0)
    pieces_m = np.stack([size * (SETTLES @ each) + lifted_m for each in ends])
    return Trajectory(size * np.append(0.0, np.cumsum(durations_s)), pieces_m)


LENGTHS = (11,) * 120 + (6,) * 18 + (10,) * 5 + (32,) * 4 + (1,) * 6
"""Pieces of each of 153 files."""


def polynomials(at: int, size: float) -> bytes:
    rows = polynomial_rows(curve(LENGTHS[at], at, size))
    return STYLES[at % len(STYLES)](rows).encode()


def fleet(show: DrawnShow, longest_s: float, style: Callable[[list[str]], str]) -> bytes:
    """A zip of the polynomials of each vehicle; its files are not in their order."""
    rows = [
        polynomial_rows(in_pieces(show.trajectories.of_vehicle(row), longest_s)) for row in range(len(show))
    ]
    names = [f"pps/cf{row + 1}.csv" for row in range(len(show))]
    return zipped({name: style(written) for name, written in sorted(zip(names, rows, strict=True))})


# shows of our own

SPACINGS_M = (3.0, 3.5, 4.5, 2.5, 6.0, 1.4)
"""Vehicles 1.4 m apart are below the floor."""


def generated(at: int) -> tuple[str, bytes]:
    """The suffix and the content of one of the generated shows."""
    rng = np.random.default_rng(1000 + at)
    shapes = rng.permutation(list(SHAPES))[: rng.integers(1, 4)].tolist()
    vehicles, spacing = int(rng.integers(1, 17)), SPACINGS_M[at % len(SPACINGS_M)]
    show = drawn_show(vehicles, float(rng.uniform(15.0, 30.0)), spacing, shapes, at)
    if at % 4 == 3:
        return ".zip", fleet(show, float(rng.choice([1.0, 2.5, 1e9])), STYLES[at // 4 % len(STYLES)])
    suffix = ".zip" if at % 4 == 2 else ".skyc"
    return suffix, EXPORTED[suffix](show)


def made() -> Iterator[Drawing]:
    """Yield all drawings."""
    for generator in GENERATORS:
        yield Drawing("generators", f"{generator.__name__}.skyc", partial(_zipped, generator))
    for kind, size in (("csv indoors", 1.0), ("csv", 2.0)):
        for at in range(len(LENGTHS)):
            yield Drawing(kind, f"cf{at}.csv", partial(polynomials, at, size))
    for at in range(200):
        suffix = ".zip" if at % 4 > 1 else ".skyc"
        yield Drawing("generated", f"show{at}{suffix}", partial(_generated, at))


def _zipped(generator: Callable[[], Mapping[str, object]]) -> bytes:
    return zipped(generator())


def _generated(at: int) -> bytes:
    return generated(at)[1]


# what becomes of each


@dataclass
class Outcome:
    """What became of one drawing."""

    kind: str
    name: str
    vehicles: int = 0
    refused: str = ""  # by import or check, in their words
    apart_m: float = 0.0  # of the drawing after an export, greatest
    colours: float = 0.0  # likewise, of 255
    rms_m: float = 0.0  # track error
    max_m: float = 0.0
    closest_m: float = 0.0
    violations: int = 0
    missing: int = 0  # not landed


def flown(drawing: Drawing) -> Outcome:
    """Import, check, export, read again and fly one drawing."""
    outcome = Outcome(drawing.kind, drawing.name)
    with tempfile.TemporaryDirectory(prefix="gcs-imports-") as name:
        given, target = Path(name) / f"given-{drawing.name}", Path(name) / "show.yaml"
        given.write_bytes(drawing.make())
        code, words = _run("show", "import", str(given), "-o", str(target), "--origin-else", PLACE)
        if code:
            outcome.refused = f"import: {words.replace(name, '')}"
            return outcome
        read = load(target).drawing
        assert read is not None
        outcome.vehicles = len(read)
        outcome.apart_m, outcome.colours = _after_exports(read)
        code, words = _run("show", "check", str(target), "--json")
        if code:
            problems = json.loads(words[words.index("{") :])["problems"]
            outcome.refused = "check: " + "; ".join(problem["text"] for problem in problems)
            return outcome
        _simulate(target, outcome)
    return outcome


def _run(*words: str) -> tuple[int, str]:
    printed = StringIO()
    with redirect_stdout(printed), redirect_stderr(printed):
        return main(list(words)), printed.getvalue().strip()


def _after_exports(made_show: DrawnShow) -> tuple[float, float]:
    """Greatest distance and difference of colour of what is read again, to the end of the lights."""
    end_s = max(made_show.duration_s, made_show.lights.end_s)
    times_s, apart_m, colours = np.arange(0.003, end_s + 1.0, 0.11), 0.0, 0.0
    for suffix in (".skyc", ".zip"):
        again = parse_drawing(EXPORTED[suffix](made_show), f"a{suffix}")
        off_m = again.trajectories.positions_m(times_s) - made_show.trajectories.positions_m(times_s)
        apart_m = max(apart_m, float(np.linalg.norm(off_m, axis=2).max()))
        off = [again.lights.at(at_s) - made_show.lights.at(at_s) for at_s in times_s.tolist()]
        colours = max(colours, float(np.abs(off).max()))
    return apart_m, colours


def _simulate(target: Path, outcome: Outcome) -> None:
    scenario = {
        "name": "show",
        "about": "an import",
        "duration_s": 900,
        "flight": {"kind": "show", "show": str(target)},
        "judged": {"vehicles": [outcome.vehicles]},
    }
    figures: Any = run_once(Run(Scenario.model_validate(scenario), outcome.vehicles, 1))
    outcome.rms_m, outcome.max_m = figures["track"]["rms_m"], figures["track"]["max_m"]
    outcome.closest_m = figures["separation"]["minimum_m"] if outcome.vehicles > 1 else np.inf
    outcome.violations = figures["separation"]["violations"]
    outcome.missing = figures["arrival"]["expected"] - figures["arrival"]["arrived"]


PHYSICAL = re.compile(
    r"drawn closer than the floor .* at [0-9.]+ s|[0-9.]+ m/s(\^2)? [a-z].*: vehicle [0-9]+ .* at [0-9.]+ s"
    r"|all vehicles are never .* at [0-9.]+ s of the drawing, .* is at"
    r"|vehicle [0-9]+ is .* the fence at [0-9.]+ s .* and .* are drawn [0-9.]+ m apart .* at [0-9.]+ s"
)
"""Refusals that say of a vehicle, or of pairs, when it cannot fly as drawn."""
