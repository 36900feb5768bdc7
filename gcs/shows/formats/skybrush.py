"""Reads `.skyc`, the compiled shows of Skybrush: a zip archive of show.json and the assets that it names.

Axes are x ahead (at `orientation` clockwise from north), y left, z up. Evidence for the handedness, as facts:
Skybrush Live and its server place shows with coordinate systems of type "nwu"; its firmware computes north =
cos x + sin y and east = sin x - cos y. Other sources: skybrush-io/skybrush.js, packages/show-format.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.model.errors import DrawingError, quoted
from gcs.model.frames import ShowFrame
from gcs.model.json_values import Value, parsed
from gcs.model.state import Array
from gcs.shows.drawn import (
    Claims,
    DrawnCue,
    DrawnShow,
    FencePolygon,
    LightPrograms,
    Trajectories,
    Trajectory,
    YawPrograms,
)
from gcs.shows.drawn.light_programs import WHITE, LightProgram
from gcs.shows.drawn.piece_index import TIME_MAX_S
from gcs.shows.drawn.yaw_programs import NO_YAW, YawProgram
from gcs.shows.format import MAX_CUES, MAX_VEHICLES
from gcs.shows.formats.archive import Archive
from gcs.shows.formats.samples import COORDINATE_MAX_M, NWU
from gcs.shows.formats.skybrush_lights import decoded
from gcs.shows.formats.skybrush_trajectory import has_yaw, read_trajectory

COEFFICIENTS_MAX: Final = 8_000_000
"""Numbers of all trajectories together: 64 MB."""

LIGHT_STEPS_MAX: Final = 2_000_000
LIGHT_PIECES_MAX: Final = 1_000_000
YAWS_MAX: Final = 100_000
POLYGONS_MAX: Final = 100
CORNERS_MAX: Final = 1_000
REFERENCES_MAX: Final = 4
"""Of references that lead to references."""

LANDS_WITHIN_M: Final = 1.0
"""A `landAt` this near to the home is the home."""

NAME_MAX: Final = 120
TITLE_MAX: Final = 1_000
SHOW: Final = "show.json"
"""The entry that only a compiled show has."""


_READ: Final = {
    "the show": "version swarm settings environment meta media",
    "environment": "type location",
    "location": "origin orientation",
    "meta": "title id inputs sources segments",
    "swarm": "drones",
    "settings": "cues validation geofence",
    "geofence": "version polygons",
    "validation": "maxAltitude maxVelocityXY maxVelocityZ maxVelocityZUp minDistance",
    "a drone": "type settings",
    "a drone's settings": "name home landAt trajectory lights yawControl pyro",
    "a trajectory": "version points takeoffTime landingTime type",
    "yawControl": "version autoYaw autoYawOffset setpoints",
}
"""Keys of each object that are read, or that say nothing about the flight; others are noted."""

OTHERS_NAMED: Final = 20
"""Most keys that are noted because nothing reads them."""

NO_PYRO: Final = "pyrotechnics are not fired"
_NOTHING: Final[Sequence[object]] = (None, {}, [], "")


@dataclass(frozen=True, slots=True, eq=False)
class _Drone:
    """One entry of swarm.drones."""

    name: str
    trajectory: Trajectory
    lights: Value | None  # as written
    yaw: YawProgram
    home_m: Array  # (3,)
    takeoff_s: float
    landing_s: float


def read_skyc(archive: Archive) -> DrawnShow:
    """Read a compiled show. Raises: DrawingError."""
    return _Reader(archive).show()


class _Reader:
    def __init__(self, archive: Archive) -> None:
        self._archive = archive
        self._notes: dict[str, int] = {}  # what is not used, and for how many drones
        self._pieces = self._terms = self._light_steps = self._light_pieces = 0

    def show(self) -> DrawnShow:
        root = self._document(self._archive.find(SHOW))
        root.version(1)
        swarm = self._need(root, "swarm")
        self._note_others("the show", root)
        self._note_others("swarm", swarm)
        listed = self._need(swarm, "drones")
        drones = [self._drone(one, row) for row, one in enumerate(listed.values(MAX_VEHICLES))]
        if not drones:
            raise DrawingError(listed.place, "a drone is needed")
        settings, meta = self._get(root, "settings"), self._get(root, "meta")
        title = None if meta is None else self._get(meta, "title")
        media = self._get(root, "media")
        if media is not None and media.raw:
            self._note("media, for example music, is not played")
        for what, value in (("settings", settings), ("meta", meta)):
            if value is not None:
                self._note_others(what, value)
        end_s = max(1.0, *(float(one.trajectory.times_s[-1]) for one in drones))
        lights = [self._light(one.lights, end_s) for one in drones]
        return DrawnShow(
            title="" if title is None else title.text(TITLE_MAX),
            vehicles=tuple(one.name for one in drones),
            trajectories=Trajectories.joined([one.trajectory for one in drones]),
            lights=LightPrograms.joined(lights),
            yaw=YawPrograms.joined([one.yaw for one in drones]),
            home_m=np.stack([one.home_m for one in drones]),
            takeoff_s=np.array([one.takeoff_s for one in drones]),
            landing_s=np.array([one.landing_s for one in drones]),
            origin=self._origin(root),
            cues=() if settings is None else self._cues(settings),
            claims=Claims() if settings is None else self._claims(settings),
            fence=() if settings is None else self._fence(settings),
            show_s=None if meta is None else self._segment(meta),
            notes=tuple(
                f"{text} ({count} drones)" if count > 1 else text for text, count in self._notes.items()
            ),
        )

    # references

    def _document(self, entry: str) -> Value:
        place = f"{self._archive.file}: {entry}"
        return parsed(self._archive.read(entry), place)

    def _followed(self, value: Value) -> Value:
        """Return what a reference {"$ref": "./a.json"} leads to; any other value as it is."""
        for _ in range(REFERENCES_MAX):
            if not isinstance(value.raw, dict) or "$ref" not in value.raw:
                return value
            base = value.document.removeprefix(f"{self._archive.file}: ")
            value = self._document(self._archive.resolve(base, value.need("$ref").text(1000)))
        raise DrawingError(value.place, f"more than {REFERENCES_MAX} references, one after the other")

    def _get(self, value: Value, key: str) -> Value | None:
        found = value.get(key)
        return None if found is None else self._followed(found)

    def _need(self, value: Value, key: str) -> Value:
        return self._followed(value.need(key))

    def _note(self, text: str) -> None:
        self._notes[text] = self._notes.get(text, 0) + 1

    def _note_others(self, what: str, value: Value) -> None:
        """Note the keys of an object that nothing reads."""
        if not isinstance(value.raw, dict):
            return
        for key, raw in value.raw.items():
            if key in _READ[what].split() or raw in _NOTHING or key.startswith("$"):
                continue
            note = f"{quoted(key)} of {what} is not read"
            self._note(note if note in self._notes or len(self._notes) < OTHERS_NAMED else "further keys")

    # drones

    def _drone(self, value: Value, row: int) -> _Drone:
        drone = self._followed(value)
        settings = self._need(drone, "settings")
        written = self._need(settings, "trajectory")
        for what, one in (("a drone", drone), ("a drone's settings", settings), ("a trajectory", written)):
            self._note_others(what, one)
        trajectory = read_trajectory(written)
        self._pieces += len(trajectory.coefficients_m)
        self._terms = max(self._terms, trajectory.coefficients_m.shape[1])
        if self._pieces * self._terms * 3 > COEFFICIENTS_MAX:
            raise DrawingError(
                written.place, f"more than {COEFFICIENTS_MAX} numbers in all trajectories so far"
            )
        takeoff, landing = written.get("takeoffTime"), written.get("landingTime")
        takeoff_s = 0.0 if takeoff is None else takeoff.number(0.0, TIME_MAX_S)
        end_s = float(trajectory.times_s[-1])
        landing_s = end_s if landing is None else landing.number(0.0, TIME_MAX_S)
        name, home = settings.get("name"), settings.get("home")
        begin_m = trajectory.coefficients_m[0, 0]
        pyro = self._get(settings, "pyro")
        if pyro is not None and pyro.raw:
            self._note(NO_PYRO)
        if has_yaw(written):
            self._note("yaw in the fourth coordinate of a trajectory is not flown: draw it as yawControl")
        home_m, lands = begin_m if home is None else _place(home), settings.get("landAt")
        if lands is not None and float(np.hypot(*(_place(lands) - home_m)[:2])) > LANDS_WITHIN_M:
            self._note("landAt is not flown to: vehicles land on the pads")
        return _Drone(
            f"drone {row + 1}" if name is None else name.text(NAME_MAX),
            trajectory,
            self._get(settings, "lights"),
            self._yaw(settings),
            home_m,
            takeoff_s,
            max(landing_s, takeoff_s),
        )

    def _light(self, lights: Value | None, end_s: float) -> LightProgram:
        """Return a program to its own end, which may come after that of the show."""
        if lights is None:
            return WHITE
        lights.version(1)
        code = lights.need("data")
        found = decoded(code.text(400_000), code.place, end_s)
        self._light_steps += found.steps
        self._light_pieces += len(found.program.before)
        if self._light_steps > LIGHT_STEPS_MAX or self._light_pieces > LIGHT_PIECES_MAX:
            most = f"{LIGHT_STEPS_MAX} commands or {LIGHT_PIECES_MAX} colours"
            raise DrawingError(code.place, f"more than {most} in all light programs so far")
        if found.fires_pyro:
            self._note(NO_PYRO)
        if found.is_cut:
            self._note(f"lights after {found.program.times_s[-1]:.0f} s are not shown: too many loops")
        return found.program

    def _yaw(self, settings: Value) -> YawProgram:
        yaw = self._get(settings, "yawControl")
        if yaw is None:
            return NO_YAW
        yaw.version(1)
        self._note_others("yawControl", yaw)
        automatic = yaw.get("autoYaw")
        if automatic is not None and automatic.raw:
            self._note("yaw along the motion is not flown")
            return NO_YAW
        written = yaw.get("setpoints")
        times_s: list[float] = []
        yaws_deg: list[float] = []
        for point in () if written is None else written.values(YAWS_MAX):
            pair = list(point.values(2))
            if len(pair) != 2:
                raise point.wrong("[time, yaw in degrees]")
            times_s.append(pair[0].number(times_s[-1] + 1e-6 if times_s else 0.0, TIME_MAX_S))
            yaws_deg.append(pair[1].number(-1e6, 1e6))
        return YawProgram(np.array(times_s), np.radians(yaws_deg))

    # the whole show

    def _origin(self, root: Value) -> ShowFrame | None:
        environment = self._get(root, "environment")
        if environment is None:
            return None
        self._note_others("environment", environment)
        location = self._get(environment, "location")
        if location is None:
            return None
        self._note_others("location", location)
        numbers = list(location.need("origin").values(3))
        if len(numbers) < 2:
            raise location.need("origin").wrong("[latitude, longitude, altitude]")
        degrees = [one.number(-1.8e9, 1.8e9) for one in numbers[:2]]
        altitude_m = numbers[2].number(-1e7, 1e7) if len(numbers) > 2 and numbers[2].raw is not None else None
        if max(map(abs, degrees)) > 180.0:  # as Skybrush Studio writes them: in 1e-7 degrees, and millimetres
            degrees = [one * 1e-7 for one in degrees]
            altitude_m = None if altitude_m is None else altitude_m * 1e-3
        if altitude_m is None:
            self._note("the file has a place on Earth without its altitude: 0 m AMSL is assumed")
        if abs(degrees[0]) > 90.0 or abs(degrees[1]) > 180.0:
            raise location.need("origin").wrong("a latitude up to 90 and a longitude up to 180 degrees")
        heading = location.get("orientation")
        heading_deg = 0.0 if heading is None else heading.number(-360.0, 360.0)
        return ShowFrame(degrees[0], degrees[1], altitude_m or 0.0, heading_deg)

    def _cues(self, settings: Value) -> tuple[DrawnCue, ...]:
        cues = self._get(settings, "cues")
        items = None if cues is None else cues.get("items")
        found = [
            DrawnCue(item.need("name").text(NAME_MAX), item.need("time").number(0.0, TIME_MAX_S))
            for item in (() if items is None else items.values(MAX_CUES))
        ]
        return tuple(sorted(found, key=lambda cue: cue.at_s))

    def _claims(self, settings: Value) -> Claims:
        validation = self._get(settings, "validation")
        if validation is None:
            return Claims()
        self._note_others("validation", validation)

        def claim(key: str) -> float | None:
            value = validation.get(key)
            return None if value is None else value.number(0.0, 1e4)

        vertical, up = claim("maxVelocityZ"), claim("maxVelocityZUp")
        return Claims(
            separation_min_m=claim("minDistance"),
            speed_max_m_s=claim("maxVelocityXY"),
            climb_max_m_s=vertical if up is None else up,
            sink_max_m_s=vertical,
            height_max_m=claim("maxAltitude"),
        )

    def _fence(self, settings: Value) -> tuple[FencePolygon, ...]:
        fence = self._get(settings, "geofence")
        if fence is None:
            return ()
        self._note_others("geofence", fence)
        polygons, found = self._get(fence, "polygons"), []
        for polygon in () if polygons is None else polygons.values(POLYGONS_MAX):
            corners = [_place(one)[:2] for one in polygon.need("points").values(CORNERS_MAX)]
            if len(corners) > 1 and (corners[0] == corners[-1]).all():
                corners.pop()  # closed, as GIS programs write polygons
            if len(corners) < 3:
                raise DrawingError(polygon.place, f"{len(corners)} corners: at least 3")
            inclusion = polygon.get("isInclusion")
            if inclusion is not None and not isinstance(inclusion.raw, bool):
                raise inclusion.wrong("true or false")
            found.append(FencePolygon(np.stack(corners), inclusion is None or bool(inclusion.raw)))
        return tuple(found)

    def _segment(self, meta: Value) -> tuple[float, float] | None:
        segments = self._get(meta, "segments")
        show = None if segments is None else segments.get("show")
        if show is None:
            return None
        ends = [one.number(0.0, TIME_MAX_S) for one in show.values(2)]
        if len(ends) != 2 or not ends[0] < ends[1]:
            raise show.wrong("[begin, end] in seconds")
        return ends[0], ends[1]


def _place(value: Value) -> Array:
    """(3,) A position [x, y] or [x, y, z] in the show frame."""
    numbers = [one.number(-COORDINATE_MAX_M, COORDINATE_MAX_M) for one in value.values(3)]
    if len(numbers) < 2:
        raise value.wrong("[x, y, z]")
    return np.array([*numbers, 0.0][:3]) * NWU
