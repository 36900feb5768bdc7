"""One state as bytes, read back by the document that tells how (docs/stream.md)."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs.api.schemas import binary_frame as frames
from gcs.api.schemas import convert
from gcs.api.schemas.fleet import FRAME_COLUMNS
from gcs.estimation.time_estimates import Estimates
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Mode
from gcs.service import Features, SelectedShow
from gcs.service.features import NO_LABEL
from gcs.testing.views import vehicles_of
from tests.support.api_fake_service import FRAME, FakeService
from tests.support.timecode import VIEW

DOCUMENT = (Path(__file__).parents[3] / "docs" / "stream.md").read_text(encoding="utf-8")


def decoded(data: bytes) -> tuple[Any, dict[str, NDArray[Any]]]:
    """As docs/stream.md says."""
    header = np.frombuffer(data, frames.HEADER, 1)[0]
    n = int(header["n"])
    names = [column.name for column in FRAME_COLUMNS]
    f = len(names)
    assert len(data) == 128 + (4 * f + 7) * n
    floats = np.frombuffer(data, "<f4", f * n, 128).reshape(f, n)
    small = np.frombuffer(data, np.uint8, 7 * n, 128 + 4 * f * n).reshape(7, n)
    return header, dict(zip(names, floats, strict=True)) | dict(zip(frames.BYTES, small, strict=True))


def encoded(service: FakeService, **changes: Any) -> tuple[Any, dict[str, NDArray[Any]]]:
    view = replace(service.view.value, **changes)
    return decoded(frames.encode(view, FRAME, revision=7, alive=True))


def test_frame_encodes_the_snapshot() -> None:
    service = FakeService()
    service.fly()
    service.phases["d3"] = Phase.LOST
    service.tick()
    header, columns = encoded(service, countdown_s=3.5)
    view = service.view.value
    assert (header["version"], header["control_alive"], header["n"], header["revision"]) == (4, 1, 3, 7)
    assert list(ShowPhase)[header["show"]] is ShowPhase.RUNNING
    assert (header["time_s"], header["unix_time_s"]) == (view.time_s, view.unix_time_s)
    assert (header["center_x_m"], header["center_y_m"], header["center_height_m"]) == (1.0, 2.0, 20.0)
    assert (header["radius_m"], header["minimum_separation_m"], header["countdown_s"]) == (9.0, 5.0, 3.5)
    assert np.isnan(header["clock_s"])
    assert (header["tick_count"], header["interventions"]) == (view.tick.count, 7)
    for row, vehicle in enumerate(vehicles_of(view)):
        assert list(Phase)[columns["phase"][row]] is vehicle.phase
        assert list(Mode)[columns["mode"][row]] is vehicle.mode
        assert columns["landed"][row] == vehicle.landed
        place_m = [columns[name][row] for name in ("x_m", "y_m", "height_m")]
        if vehicle.position_m is None:
            assert np.isnan(place_m).all()
        else:
            x_m, y_m, z_m = vehicle.position_m
            assert place_m == pytest.approx([x_m, y_m, -z_m])
    assert columns["heading_deg"][:2].tolist() == [90.0, 90.0]
    assert columns["vup_m_s"][0] == pytest.approx(-0.3)
    assert columns["setpoint_up_m_s"][0] == 1.0
    assert np.isnan(columns["setpoint_up_m_s"][2])
    assert columns["heartbeat_age_s"][:2].tolist() == pytest.approx([np.nan, np.nan], nan_ok=True)
    assert columns["flags"].tolist() == [
        frames.ARMED | frames.READY | frames.LIMITED | frames.COMMANDED | frames.LIT,
        frames.ARMED | frames.READY | frames.COMMANDED | frames.LIT,
        0,
    ]
    colours = np.stack([columns[name] for name in ("red", "green", "blue")], axis=1)
    assert colours.tolist() == [[255, 128, 0], [255, 128, 0], [0, 0, 0]]


def test_unknown_values_are_absent_from_the_frame() -> None:
    header, columns = encoded(FakeService())
    assert header["has_center"] == 0
    for name in ("center_x_m", "center_height_m", "radius_m", "minimum_separation_m", "countdown_s"):
        assert np.isnan(header[name]), name
    assert columns["red"].tolist() == [0, 0, 0]


def test_timecode_is_in_the_header() -> None:
    header, _ = encoded(FakeService(), features=Features(timecode=VIEW))
    assert header["label"].tolist() == [1, 0, 2, 12]
    assert (header["behind_s"], header["tempo"]) == pytest.approx((0.012, 1.001))
    for nowhere in (None, replace(VIEW, label="", behind_s=np.nan, tempo=np.nan)):
        header, _ = encoded(FakeService(), features=Features(timecode=nowhere))
        assert tuple(header["label"].tolist()) == NO_LABEL
        assert np.isnan([header["behind_s"], header["tempo"]]).all()


def test_counters_wrap_and_headings_stay_below_360() -> None:
    service = FakeService()
    view = service.view.value
    rows = replace(view.rows, yaw_rad=np.radians([-90.0 - 1e-9, 270.0, 0.0]))
    clock = SelectedShow("s", "ab", "c", ("c",), 12.25, 60.0, runs=True, target_is_live=False)
    header, columns = encoded(service, rows=rows, setpoints_sent=2**32 + 5, selected=clock)
    assert header["setpoints_sent"] == 5
    assert header["clock_s"] == 12.25
    assert columns["heading_deg"].tolist() == [0.0, 0.0, 90.0]


def test_document_describes_the_bytes_as_they_are() -> None:
    fields = frames.HEADER.fields
    assert fields is not None
    reported = {
        int(at)
        for row in re.findall(r"^\| ([\d, ]+) \| \w+ \|", DOCUMENT, re.MULTILINE)
        for at in row.split(",")
    }
    assert reported == {offset for _, offset, *_ in fields.values()}
    behind = DOCUMENT.partition("From byte 128 + 4 f n on")[2]
    places = [re.search(rf"\b{name}\b", behind) for name in frames.BYTES]
    found = [place.start() for place in places if place is not None]
    assert len(found) == len(frames.BYTES)
    assert found == sorted(found)
    for kinds in (Phase, Mode, ShowPhase):
        assert ", ".join(f"{number} {kind.value}" for number, kind in enumerate(kinds)) in DOCUMENT


def test_estimates_are_in_the_header_and_for_each_vehicle() -> None:
    found = Estimates(
        low_s=np.array([120.0, np.nan, 90.0]),
        empty_s=np.array([240.0, np.nan, 180.0]),
        battery_least=0.375,
        battery_least_row=2,
        battery_median=0.5,
        low_row=2,
        assembled_s=None,
        home_s=45.0,
    )
    header, columns = encoded(FakeService(), estimates=found)
    assert (header["battery_least"], header["battery_median"], header["home_s"]) == (0.375, 0.5, 45.0)
    assert np.isnan(header["assembled_s"])
    assert header["battery_least_row"] == 2
    np.testing.assert_array_equal(columns["low_s"], [120.0, np.nan, 90.0])
    np.testing.assert_array_equal(columns["empty_s"], [240.0, np.nan, 180.0])
    view = replace(FakeService().view.value, estimates=found)
    fleet = convert.fleet(view, FRAME, "", "off")
    assert fleet.estimates is not None
    assert (fleet.estimates.low_s, fleet.estimates.low_vehicle) == (90.0, "d3")
    assert (fleet.estimates.empty_s, fleet.estimates.battery_least_vehicle) == (180.0, "d3")
    assert [each.low_s for each in fleet.vehicles] == [120.0, None, 90.0]
    unknown = header_of_nothing()
    assert unknown["battery_least_row"] == frames.NO_ROW
    assert np.isnan(unknown["battery_least"])


def test_json_vehicles_have_the_numbers_of_a_frame() -> None:
    service = FakeService()
    service.fly()
    _, columns = encoded(service)
    vehicles = convert.vehicles(service.view.value, FRAME)
    for name in frames.FLOATS:
        numbers = np.array([getattr(each, name) for each in vehicles], dtype=np.float32)  # None: NaN
        np.testing.assert_allclose(numbers, columns[name], rtol=1e-6, err_msg=name)


def header_of_nothing() -> Any:
    return encoded(FakeService())[0]
