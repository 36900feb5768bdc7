"""A recorded track, played as if it were live: CSV, GPX or a telemetry log.

Velocities are not given: the estimator finds them, as it does for a receiver that reports none.
"""

import asyncio
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from math import inf, nan
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple, TypeAlias
from xml.parsers import expat

import numpy as np

from gcs.links.intake import Intake
from gcs.links.targets.mavlink import ALTITUDE_MAX_M, ALTITUDE_MIN_M, place
from gcs.links.targets.settings import PathSource
from gcs.mavlink import codec
from gcs.mavlink.framing import GLOBAL_POSITION_INT
from gcs.mavlink.kernels import BEGIN, END, LONGEST_FRAME, MESSAGE, SYSTEM
from gcs.model.errors import LinkError, quoted
from gcs.model.target_fix import TargetFix

log = logging.getLogger(__name__)

SIZE_MAX: Final = 64 << 20
POINTS_MAX: Final = 100_000
"""Of a file; 10 a second for two and a half hours."""

PIECE_BYTES: Final = 1 << 13
"""So much is read before other tasks run."""

POINTS_AT_ONCE: Final = 100
LINE_MAX: Final = 1000
TAG_MAX: Final = 1 << 16
"""Longest line of a CSV and longest tag of a GPX, in bytes."""

LEAST_S: Final = 0.02
"""Reports are at least so far apart; of points that are closer the newest is reported."""

STILL_S: Final = 1.0
"""At the end of a track that is not repeated, its last position is reported so often."""

RETRY_S: Final = 10.0
COLUMNS: Final = ("time_s", "latitude_deg", "longitude_deg")
ALTITUDE: Final = "altitude_amsl_m"
_STAMP_BYTES: Final = 8
_STAMP_MAX_US: Final = 4_102_444_800_000_000  # 2100: other bytes are no time


class Point(NamedTuple):
    """One position of a track, by the track's own clock."""

    time_s: float
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float = nan


Work: TypeAlias = Iterator[Point | None]
"""Points as they are read; None: a piece without one."""


async def keep_receiving(
    source: PathSource,
    take: Callable[[TargetFix], None],
    failed: Callable[[str], None],
    intake: Intake,  # noqa: ARG001 - a file has no sender
) -> None:
    """Play the track without end: give each report to `take`, what is wrong in the file to `failed`."""
    logged = ""
    while True:
        try:
            track = await _read(points(source.file, source.system_id), source.file)
        except (OSError, UnicodeError, LinkError) as error:
            why = str(error)
            if why != logged:
                log.warning("target_interrupted", extra={"source": str(source.file), "cause": why})
            logged = why
            failed(why)
            await asyncio.sleep(RETRY_S)
        else:
            await _play(track, source.repeat, take)


async def _play(track: Sequence[Point], repeat: bool, take: Callable[[TargetFix], None]) -> None:
    """Report each point when it is due; a later round begins one interval after the last point."""
    clock = asyncio.get_running_loop().time
    first_s, last_s = track[0].time_s, track[-1].time_s
    round_s = last_s - first_s + max(LEAST_S, last_s - track[-2].time_s if len(track) > 1 else STILL_S)
    begin_s, at = clock() + LEAST_S, 0
    while at < len(track):
        await asyncio.sleep(max(LEAST_S, begin_s + track[at].time_s - first_s - clock()))
        while at + 1 < len(track) and begin_s + track[at + 1].time_s - first_s <= clock():
            at += 1  # the loop is late, or they are close together
        take(_fix(track[at], clock(), begin_s + track[at].time_s - first_s))
        at += 1
        if at == len(track) and repeat:
            begin_s, at = max(begin_s + round_s, clock() - round_s), 0
    while True:
        await asyncio.sleep(STILL_S)
        take(_fix(track[-1], clock(), clock()))


def _fix(point: Point, now_s: float, source_s: float) -> TargetFix:
    return TargetFix(now_s, point.latitude_deg, point.longitude_deg, point.altitude_amsl_m, source_s=source_s)


async def _read(work: Work, file: Path) -> list[Point]:
    """All points, while other tasks run. Raises: as `points`."""
    track: list[Point] = []
    for point in work:
        if point is not None:
            track.append(point)
        if len(track) > POINTS_MAX:
            raise LinkError(f"{file} has more than {POINTS_MAX} positions; cut it, or thin it out")
        if point is None or len(track) % POINTS_AT_ONCE == 0:
            await asyncio.sleep(0)
    if not track:
        raise LinkError(f"{file} has no position")
    return track


def points(file: Path, system_id: int = 0) -> Work:
    """The positions of a track, in the order of their times.

    Args:
        file: of one of the formats, by its suffix.
        system_id: in a telemetry log, of the target; 0: the first system with a position.

    Raises: OSError where it cannot be read; LinkError with the place of what is wrong.
    """
    suffix = file.suffix.lower()
    if suffix not in _FORMATS and suffix != ".tlog":
        raise LinkError(f"{file}: a track is a .csv, a .gpx or a .tlog file")
    if not file.is_file():
        raise LinkError(f"{file} does not exist, or is no file")
    size = file.stat().st_size
    if size > SIZE_MAX:
        raise LinkError(f"{file} has {size / 1e6:.0f} MB; at most {SIZE_MAX / 1e6:.0f} MB are read")
    pieces = _pieces(file)
    return _of_log(pieces, file, system_id) if suffix == ".tlog" else _FORMATS[suffix](pieces, file)


def _pieces(file: Path) -> Iterator[bytes]:
    left = SIZE_MAX
    with file.open("rb") as opened:
        while left > 0 and (piece := opened.read(PIECE_BYTES)):
            left -= len(piece)
            yield piece


def _lines(pieces: Iterator[bytes], file: Path) -> Iterator[tuple[str, str]]:
    """Each line with its place; empty ones count as well, or they could be without end."""
    number, rest = 0, b""
    for piece in pieces:
        *lines, rest = (rest + piece).split(b"\n")
        lines += [rest] if len(rest) > LINE_MAX else []
        for line in lines:
            number += 1
            yield _line(line, f"{file}, line {number}")
        if number > 2 * POINTS_MAX:
            raise LinkError(f"{file} has more than {2 * POINTS_MAX} lines; cut it, or thin it out")
    yield _line(rest, f"{file}, line {number + 1}")


def _line(line: bytes, where: str) -> tuple[str, str]:
    if len(line) > LINE_MAX:
        raise LinkError(f"{where} has more than {LINE_MAX} bytes: no CSV")
    try:
        return line.decode("utf-8-sig").strip(), where
    except UnicodeDecodeError:
        raise LinkError(f"{where} is no text in UTF-8: {quoted(line)}") from None


def _of_csv(pieces: Iterator[bytes], file: Path) -> Work:
    """Lines with commas, below a header that names the columns; others are ignored."""
    lines = _lines(pieces, file)
    header, where = next(lines)
    names = [name.strip() for name in header.split(",")]
    missing = [column for column in COLUMNS if column not in names]
    if missing:
        form = f"{','.join(COLUMNS)} and, if known, {ALTITUDE}"
        raise LinkError(f"{where}: the header has no {', '.join(missing)}; it names {form}")
    before_s = -inf
    for line, place_of_line in lines:
        if not line:
            yield None
            continue
        fields = [field.strip() for field in line.split(",")]
        if len(fields) != len(names):
            raise LinkError(f"{place_of_line} has {len(fields)} values, and the header {len(names)}")
        point = _point(dict(zip(names, fields, strict=True)), place_of_line)
        before_s = _later(point, before_s, place_of_line)
        yield point


def _point(texts: Mapping[str, str], where: str) -> Point:
    altitude = texts.get(ALTITUDE, "")
    return Point(
        _number(texts, "time_s", -1e12, 1e12, where),
        _number(texts, "latitude_deg", -90.0, 90.0, where),
        _number(texts, "longitude_deg", -180.0, 180.0, where),
        _number(texts, ALTITUDE, ALTITUDE_MIN_M, ALTITUDE_MAX_M, where) if altitude else nan,
    )


def _number(texts: Mapping[str, str], name: str, least: float, most: float, where: str) -> float:
    text = texts.get(name, "")
    try:
        value = float(text)
    except ValueError:
        value = nan
    if not least <= value <= most:
        raise LinkError(f"{where}: {name} is {quoted(text)}; a number from {least:g} to {most:g} is needed")
    return value


def _later(point: Point, before_s: float, where: str) -> float:
    if point.time_s <= before_s:
        raise LinkError(f"{where}: its time is not later than that of the position before")
    return point.time_s


def _of_gpx(pieces: Iterator[bytes], file: Path) -> Work:
    """Track points with their times; heights are those of the file, above mean sea level."""
    reader = GpxReader(file)
    for piece in pieces:
        yield None
        yield from reader.take(piece)
    yield from reader.take(b"", last=True)


class GpxReader:
    """Reads track points, piece by piece, and refuses what XML offers beside tags: no DTD, no entities."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._parser = expat.ParserCreate("utf-8", " ")
        self._parser.StartDoctypeDeclHandler = self._refuse
        self._parser.StartElementHandler = self._begin
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._take_text
        self._taken = 0
        self._before_s = -inf
        self._point: dict[str, str] | None = None
        self._text = ""
        self._ready: list[Point] = []

    def take(self, piece: bytes, *, last: bool = False) -> list[Point]:
        """The points that end in this piece. Raises: LinkError with the line of what is wrong."""
        try:
            self._parser.Parse(piece, last)
        except expat.ExpatError as error:
            reason = expat.ErrorString(error.code)
            raise LinkError(f"{self._file}, line {error.lineno} is no XML in UTF-8: {reason}") from None
        self._taken += len(piece)
        if self._taken - self._parser.CurrentByteIndex > TAG_MAX:
            raise LinkError(f"{self._where()} has a tag of more than {TAG_MAX} bytes: no GPX")
        ready, self._ready = self._ready, []
        return ready

    def _where(self) -> str:
        return f"{self._file}, line {self._parser.CurrentLineNumber}"

    def _refuse(self, *_: object) -> None:
        raise LinkError(f"{self._where()} defines a document type (DOCTYPE), which no GPX needs; remove it")

    def _begin(self, name: str, attributes: dict[str, str]) -> None:
        self._text = ""
        if _local(name) == "trkpt":
            self._point = {
                "latitude_deg": attributes.get("lat", ""),
                "longitude_deg": attributes.get("lon", ""),
            }

    def _take_text(self, text: str) -> None:
        self._text = (self._text + text)[:LINE_MAX]

    def _end(self, name: str) -> None:
        if self._point is None:
            return
        if _local(name) == "ele":
            self._point[ALTITUDE] = self._text.strip()
        elif _local(name) == "time":
            self._point["time_s"] = _seconds(self._text.strip(), self._where())
        elif _local(name) == "trkpt":
            texts, self._point = self._point, None
            if "time_s" not in texts:
                raise LinkError(f"{self._where()}: a track point without a time cannot be played")
            point = _point(texts, self._where())
            if point.time_s != self._before_s:  # phones write whole seconds, and some twice
                self._before_s = _later(point, self._before_s, self._where())
                self._ready.append(point)


def _local(name: str) -> str:
    return name.rpartition(" ")[2]


def _seconds(text: str, where: str) -> str:
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise LinkError(f"{where}: time {quoted(text)} is not as 2026-05-01T10:00:00Z") from None
    return str((moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp())


def _of_log(pieces: Iterator[bytes], file: Path, system_id: int) -> Work:
    """Positions of a system, each with the time before its frame; damaged bytes are skipped."""
    rest, before_s, others = b"", -inf, set[int]()
    for piece in pieces:
        yield None
        data = np.frombuffer(bytearray(rest + piece), np.uint8)
        frames = codec.find(data, np.zeros(1, np.int64), np.array([len(data)])).frames
        ends = int(frames[-1, END]) if len(frames) else 0
        rest = data[max(ends, len(data) - LONGEST_FRAME - _STAMP_BYTES) :].tobytes()
        frames = frames[(frames[:, MESSAGE] == GLOBAL_POSITION_INT) & (frames[:, BEGIN] >= _STAMP_BYTES)]
        for frame, record in zip(frames, codec.decode(GLOBAL_POSITION_INT, data, frames), strict=True):
            stamp = data[frame[BEGIN] - _STAMP_BYTES : frame[BEGIN]].tobytes()
            point = _logged(int.from_bytes(stamp, "big"), record)
            if point is None:
                continue
            system_id = system_id or int(frame[SYSTEM])
            if frame[SYSTEM] != system_id:
                others.add(int(frame[SYSTEM]))
            elif point.time_s > before_s:
                before_s = point.time_s
                yield point
    if before_s == -inf and others:
        systems = ", ".join(map(str, sorted(others)))
        raise LinkError(f"{file} has no position of system {system_id}, but of {systems}")


def _logged(stamp_us: int, record: np.void) -> Point | None:
    """A position of a log; None where none is known yet, or the bytes before it are no time."""
    try:
        latitude_deg, longitude_deg = place(int(record["lat"]), int(record["lon"]))
    except LinkError:
        return None
    altitude_m = 1e-3 * int(record["alt"])
    is_height = ALTITUDE_MIN_M <= altitude_m <= ALTITUDE_MAX_M
    if stamp_us > _STAMP_MAX_US:
        return None
    return Point(1e-6 * stamp_us, latitude_deg, longitude_deg, altitude_m if is_height else nan)


_FORMATS: Final[Mapping[str, Callable[[Iterator[bytes], Path], Work]]] = MappingProxyType(
    {".csv": _of_csv, ".gpx": _of_gpx}
)
