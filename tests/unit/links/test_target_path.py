"""Recorded tracks are read from three formats, played in the loop's time, and refused with their line."""

import asyncio
from contextlib import suppress
from math import isnan
from pathlib import Path

import pytest

from gcs.links.intake import Bound, Intake
from gcs.links.targets import path
from gcs.links.targets.path import POINTS_AT_ONCE, POINTS_MAX, SIZE_MAX, STILL_S, TAG_MAX, Point, points
from gcs.links.targets.settings import PathSource
from gcs.links.tlog import record
from gcs.model.errors import LinkError
from gcs.model.target_fix import TargetFix
from gcs.testing.virtual_time import run_virtual
from tests.support.target_fakes import packed, position
from tests.support.work import lines_run

RECORDED = Path(__file__).parents[2] / "data" / "targets" / "px4-session.csv"
HEADER = "time_s,latitude_deg,longitude_deg\n"
GPX = '<?xml version="1.0"?>\n<gpx xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>\n'
END = "</trkseg></trk></gpx>"


def trkpt(time: str, inside: str = "<ele>488.5</ele>", latitude: str = "47.4") -> str:
    return f'<trkpt lat="{latitude}" lon="8.5">{inside}<time>{time}</time></trkpt>\n'


def read(file: Path, content: str | bytes, system_id: int = 0) -> list[Point]:
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return asyncio.run(path._read(points(file, system_id), file))


def played(file: Path, for_s: float, *, repeat: bool = True) -> tuple[list[TargetFix], list[str]]:
    fixes: list[TargetFix] = []
    reasons: list[str] = []

    async def story() -> None:
        source = PathSource(kind="path", file=file, repeat=repeat)
        task = path.keep_receiving(source, fixes.append, reasons.append, Intake("target", Bound(1.0)))
        try:
            async with asyncio.timeout(for_s):
                await task
        except TimeoutError:
            return

    run_virtual(story)
    return fixes, reasons


def test_columns_may_have_any_order_and_others_are_ignored(tmp_path: Path) -> None:
    text = "\ufefflongitude_deg, latitude_deg, note, altitude_amsl_m, time_s\r\n"
    text += "8.5,47.4,a,,1\r\n\r\n8.6,47.5,b,490.5,2.5\r\n"
    first, second = read(tmp_path / "track.csv", text)
    assert first[:3] == (1.0, 47.4, 8.5)
    assert isnan(first.altitude_amsl_m)
    assert second == (2.5, 47.5, 8.6, 490.5)


def test_gpx_is_read_in_any_namespace(tmp_path: Path) -> None:
    """Of two points of the same second the first counts: phones write whole seconds."""
    text = GPX + trkpt("2026-05-01T10:00:00Z") + trkpt("2026-05-01T10:00:00Z", latitude="47.5")
    text += trkpt("2026-05-01T12:00:01.5+02:00", "<extensions><ele/></extensions>") + END
    for content in (text, text.replace(' xmlns="http://www.topografix.com/GPX/1/1"', "")):
        first, second = read(tmp_path / "track.gpx", content)
        assert (first.latitude_deg, first.longitude_deg, first.altitude_amsl_m) == (47.4, 8.5, 488.5)
        assert second.time_s - first.time_s == 1.5
        assert isnan(second.altitude_amsl_m)


def test_log_has_the_positions_of_one_system(tmp_path: Path) -> None:
    """The first with a position, or that which is named; damaged bytes and times that go back are skipped."""
    frames = [
        record(1_000_000, packed(position(latitude=0, longitude=0), system_id=9)),
        record(1_200_000, packed(position(latitude=474_000_000))),
        b"junk" + record(1_300_000, packed(position(latitude=475_000_000), system_id=8)),
        record(1_100_000, packed(position(latitude=474_000_100))),
        record(1_400_000, packed(position(latitude=474_000_200, altitude_mm=2**31 - 1))),
    ]
    log = b"".join(frames * 1 + [record(2_000_000 + at, packed(position())) for at in range(2000)])
    track = read(tmp_path / "flight.tlog", log)
    assert [point.time_s for point in track[:3]] == pytest.approx([1.2, 1.4, 2.0])
    assert isnan(track[1].altitude_amsl_m)
    assert len(track) == 2002
    assert [point.latitude_deg for point in read(tmp_path / "flight.tlog", log, 8)] == pytest.approx([47.5])
    with pytest.raises(LinkError, match=r"flight.tlog has no position of system 3, but of 7, 8$"):
        read(tmp_path / "flight.tlog", log, 3)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.csv", "", "a.csv, line 1: the header has no time_s, latitude_deg, longitude_deg; it names"),
        ("a.csv", "time_s,latitude_deg\n", "line 1: the header has no longitude_deg"),
        ("a.csv", HEADER, "a.csv has no position"),
        ("a.csv", HEADER + "0,47,8\n1,47\n", "line 3 has 2 values, and the header 3"),
        ("a.csv", HEADER + "0,47,8\n1,4x,8\n", "line 3: latitude_deg is '4x'; a number from -90 to 90"),
        ("a.csv", HEADER + "0,91,8\n", "line 2: latitude_deg is '91'"),
        ("a.csv", HEADER + "0,47,nan\n", "line 2: longitude_deg is 'nan'; a number from -180 to 180"),
        ("a.csv", HEADER + "1,47,8\n1,47,8\n", "line 3: its time is not later than that of the position"),
        ("a.csv", HEADER + "1," + "4" * 2000, "line 2 has more than 1000 bytes: no CSV"),
        ("a.csv", HEADER.encode() + b"1,\xff\xfe,8", "line 2 is no text in UTF-8"),
        ("a.gpx", "<gpx><trkpt", "a.gpx, line 1 is no XML in UTF-8: unclosed token"),
        ("a.gpx", "<gpx/>", "a.gpx has no position"),
        ("a.gpx", GPX + '<trkpt lat="47" lon="8"/>' + END, "line 3: a track point without a time cannot be"),
        ("a.gpx", GPX + trkpt("noon") + END, "line 3: time 'noon' is not as 2026-05-01T10:00:00Z"),
        ("a.gpx", GPX + trkpt("2026-05-01", "<ele>high</ele>") + END, "altitude_amsl_m is 'high'"),
        ("a.gpx", GPX + trkpt("2026-05-02") + trkpt("2026-05-01") + END, "line 4: its time is not later"),
        ("a.gpx", '<!DOCTYPE gpx [<!ENTITY a "b">]>\n<gpx>&a;</gpx>', "defines a document type (DOCTYPE)"),
        ("a.gpx", "<gpx>&a;</gpx>", "a.gpx, line 1 is no XML in UTF-8: undefined entity"),
        ("a.gpx", f'<gpx a="{"b" * 3 * TAG_MAX}"/>', f"has a tag of more than {TAG_MAX} bytes: no GPX"),
        ("a.tlog", b"\xfe" * 5000, "a.tlog has no position"),
        ("a.kml", "", "a.kml: a track is a .csv, a .gpx or a .tlog file"),
        ("a.csv", HEADER + "".join(f"{at},4,8\n" for at in range(POINTS_MAX + 1)), "more than 100000 pos"),
        ("a.csv", HEADER + "\n" * (2 * POINTS_MAX + 20_000), "has more than 200000 lines; cut it, or thin"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_file_is_named(tmp_path: Path, name: str, content: str | bytes, says: str) -> None:
    with pytest.raises(LinkError) as error:
        read(tmp_path / name, content)
    assert says in str(error.value)


HOSTILE = {
    "blank.csv": HEADER.encode() + b"\n" * 50_000,
    "wide.csv": HEADER.encode() + (b"," * 998 + b"\n") * 50,
    "short.csv": HEADER.encode() + b"".join(b"%d,4,8\n" % at for at in range(5000)),
    "tags.gpx": b"<a>" + b"<b/>" * 12_000,
    "deep.gpx": b"<a>" * 16_000,
    "text.gpx": b"<a>" + b"&#65;" * 10_000,
    "attributes.gpx": b"<a " + b"".join(b"b%d='' " % at for at in range(5000)) + b"/>",
    "junk.tlog": b"\xfe\x00" * 25_000,
    "frames.tlog": packed(position(0, 0, 0, 0, (0, 0, 0))) * 2000,
}


@pytest.mark.parametrize("name", list(HOSTILE))
def test_other_tasks_run_while_a_file_is_read(tmp_path: Path, name: str) -> None:
    """Lines of Python between two turns of the loop; a core runs 60,000 in a few milliseconds."""
    file = tmp_path / name
    file.write_bytes(HOSTILE[name])
    work, done = points(file), False

    def turn() -> None:
        nonlocal done
        with suppress(LinkError):
            for _ in range(POINTS_AT_ONCE):
                if (point := next(work, file)) is None:
                    return
                if point is file:
                    break
            else:
                return
        done = True

    while not done:
        assert lines_run(turn) < 20_000


def test_missing_and_huge_files_are_named(tmp_path: Path) -> None:
    huge = tmp_path / "huge.tlog"
    with huge.open("wb") as file:
        file.truncate(SIZE_MAX + 1)
    for file_path, says in (
        (huge, "has 67 MB; at most 67 MB are read"),
        (tmp_path / "none.csv", "does not exist"),
    ):
        fixes, (reason, *_) = played(file_path, 15.0)
        assert (fixes, says in reason) == ([], True)


def test_file_that_is_mended_is_played(tmp_path: Path) -> None:
    file, reasons = tmp_path / "track.csv", list[str]()
    fixes: list[TargetFix] = []

    async def story() -> None:
        source = PathSource(kind="path", file=file)
        task = asyncio.create_task(
            path.keep_receiving(source, fixes.append, reasons.append, Intake("target", Bound(1.0)))
        )
        await asyncio.sleep(5.0)
        file.write_text(HEADER + "0,47.4,8.5\n")
        await asyncio.sleep(10.0)
        task.cancel()

    run_virtual(story)
    assert len(reasons) == 1
    assert fixes[0].latitude_deg == 47.4


def test_track_is_played_in_the_time_of_the_loop(tmp_path: Path) -> None:
    """A repeated track goes on without a pause, by one clock."""
    file = tmp_path / "track.csv"
    file.write_text(HEADER + "10,47.4,8.5\n10.5,47.5,8.5\n12.5,47.6,8.5\n")
    fixes, reasons = played(file, 9.0)
    times_s = [fix.arrived_s - fixes[0].arrived_s for fix in fixes]
    assert times_s == pytest.approx([0.0, 0.5, 2.5, 4.5, 5.0, 7.0], abs=0.03)
    assert [fix.source_s - fix.arrived_s for fix in fixes] == pytest.approx([0.0] * 6, abs=0.03)
    assert [fix.latitude_deg for fix in fixes] == [47.4, 47.5, 47.6] * 2
    assert reasons == []


def test_track_that_is_not_repeated_stays_at_its_end(tmp_path: Path) -> None:
    file = tmp_path / "track.csv"
    file.write_text(HEADER + "0,47.4,8.5\n1,47.5,8.5\n")
    fixes, _ = played(file, 5.5, repeat=False)
    assert [fix.latitude_deg for fix in fixes] == [47.4, 47.5, 47.5, 47.5, 47.5, 47.5]
    assert fixes[-1].arrived_s - fixes[-2].arrived_s == STILL_S


def test_positions_that_are_close_together_are_thinned_out(tmp_path: Path) -> None:
    file = tmp_path / "track.csv"
    file.write_text(HEADER + "".join(f"{at / 1000},47.4,8.5\n" for at in range(3000)))
    fixes, _ = played(file, 2.0)
    assert 90 <= len(fixes) <= 101


def test_recorded_flight_is_played_as_it_was(tmp_path: Path) -> None:
    track = asyncio.run(path._read(points(RECORDED), RECORDED))
    fixes, _ = played(RECORDED, 219.0)
    assert len(fixes) == len([point for point in track if point.time_s < 218.9])
    for fix, point in zip(fixes, track, strict=False):
        assert fix.arrived_s - fixes[0].arrived_s == pytest.approx(point.time_s, abs=0.03)
        assert (fix.latitude_deg, fix.longitude_deg) == (point.latitude_deg, point.longitude_deg)
