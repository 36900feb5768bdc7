"""A flight on a site: start, record and report carry its hash; plans that lack room are refused."""

import json
from pathlib import Path
from typing import Any

import pytest

from gcs.areas.files.site_files import written
from gcs.areas.site import FlightSite
from gcs.cli.main import main
from gcs.config.schema import Config, on_site
from gcs.model.errors import InvalidError
from gcs.model.lifecycle import ShowPhase
from gcs.model.plan import Formation, Orbit, Target
from gcs.model.preflight_report import Check, State
from gcs.recording.audit_reader import last_known
from gcs.recording.mcap_reader import FlightData
from gcs.recording.session import Record
from gcs.safety.fenced_areas import beyond_m
from gcs.service import ShowAction
from gcs.testing.virtual_show import FlownTrack, VirtualShow, fly, refused, show_config
from tests.support.audit_rows import events
from tests.support.fields import CONTINGENCY, GROUND_RISK, field

pytestmark = pytest.mark.soak

SITE = field(top_m=60.0)


def config(folder: Path, site: FlightSite = SITE, **sections: dict[str, Any]) -> Config:
    path = folder / "field.geojson"
    path.write_bytes(written(site, path))
    return on_site(show_config(4, **sections), path)


async def near_an_edge(show: VirtualShow) -> FlownTrack:
    """Take off, ask for what does not fit, fly to the edge, and come home."""
    await show.standby()
    await show.wait(5.0)  # the fence is uploaded, and read back
    await show.start()
    await show.reach(ShowPhase.RUNNING)
    plan = show.service.plan
    with pytest.raises(InvalidError, match="m are missing to area 1 of the fence"):
        plan.set_target(Target(x_m=200.0, y_m=0.0))
    with pytest.raises(InvalidError, match=r"at most [\d.]+ m at a height of .* and its areas"):
        plan.set_formation(Formation(radius_m=50.0, height_m=30.0), ["radius_m"])
    with pytest.raises(InvalidError, match=r"at most [\d.]+ m: round a target"):
        plan.set_orbit(Orbit(radius_m=80.0, speed_m_s=2.0))
    plan.set_target(Target(x_m=18.0, y_m=10.0))
    await show.wait(20.0)
    await show.show(ShowAction.STOP)
    await show.reach(ShowPhase.LANDED)
    return show.track


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Config, FlownTrack]:
    root = tmp_path_factory.mktemp("runs")
    flies = config(root)
    vehicles = {name: (row + 1, "loop") for row, name in enumerate(flies.ids)}
    with Record(root, flies.model_dump_json(), vehicles, site_hash=SITE.digest) as record:
        track = fly(near_an_edge, flies, record=record)
        assert record.problems == ()
    return root, flies, track


@pytest.mark.soak
def test_vehicles_that_were_not_weighed_do_not_start(tmp_path: Path) -> None:
    """Over a controlled ground; with their own figures they do, and where no ground is drawn."""
    ground = field(CONTINGENCY, GROUND_RISK)

    def airframe_of(site: FlightSite, **given: float) -> list[Check]:
        async def story(show: VirtualShow) -> list[Check]:
            await show.standby()
            await show.wait(5.0)
            report = show.service.preflight.report()
            named = [each for each in report.fleet if each.name == "airframe"]
            if named and not named[0].passes:
                call = await refused(show, lambda: show.service.commands.command_show(ShowAction.START))
                assert "control.safety.impact.airframe is not set" in call.text
                assert [cause.check for cause in report.causes] == ["airframe"]
                assert show.view.start_refused == report.in_short
            else:
                assert report.passes
            return named

        safety = {"safety": {"impact": {"airframe": given}}} if given else {}
        return fly(story, config(tmp_path, site, control=safety))

    (check,) = airframe_of(ground)
    assert (check.state, check.value) == (State.UNKNOWN, None)
    assert "computed for 1.5 kg, 0.04 m^2 and 0.55 m" in check.problem
    assert "mass_kg, drag_area_m2 and dimension_m" in check.to_do
    (check,) = airframe_of(ground, mass_kg=1.2, drag_area_m2=0.035, dimension_m=0.5)
    assert (check.state, check.value) == (State.PASS, 1.2)
    assert airframe_of(SITE) == []


def test_no_vehicle_leaves_the_site(flown: tuple[Path, Config, FlownTrack]) -> None:
    _, flies, track = flown
    areas = flies.control.safety.fence.areas
    assert max(beyond_m(areas, place_m[:, :2]).max() for place_m in track.true_m) < 0.0


def test_the_start_is_audited_with_its_hashes(flown: tuple[Path, Config, FlownTrack]) -> None:
    (start,) = [event["detail"] for event in events(flown[0]) if event["event"] == "start_hashes"]
    assert start["site_hash"] == SITE.digest
    assert len(start["parameters_hash"]) == 64
    assert start["command"] == "o1"
    assert "show_hash" not in start


def test_the_record_and_its_report_have_the_hash(
    flown: tuple[Path, Config, FlownTrack], tmp_path: Path
) -> None:
    session = last_known(flown[0]).session
    assert session is not None
    about = FlightData(session.folder / "flight.mcap").about
    assert about.site_hash == SITE.digest
    assert Config.model_validate(about.config).flight_site == SITE
    report, page = tmp_path / "report.json", tmp_path / "page.html"
    assert main(["report", str(flown[0]), "--report", str(report), "--html", str(page)]) == 0
    judged = json.loads(report.read_text())
    assert judged["site_hash"] == SITE.digest
    assert judged["show_hashes"] == []
    (areas,) = [check for check in judged["checks"] if check["name"] == "beyond an area of the fence"]
    assert areas["kept"]
    assert areas["worst"] < 0.0
    assert SITE.digest in page.read_text()


def test_a_report_names_who_left_the_areas(flown: tuple[Path, Config, FlownTrack], tmp_path: Path) -> None:
    """Judged by another site the same flight is broken: no report is green over what it did not look at."""
    first = SITE.flight_geography
    shifted = tuple((latitude, longitude - 0.0012) for latitude, longitude in first.corners)
    moved = FlightSite("moved", (type(first)(first.kind, first.name, shifted, 0.0, 60.0),))
    path = tmp_path / "moved.yaml"
    (tmp_path / "moved.geojson").write_bytes(written(moved, Path("moved.geojson")))
    frame = flown[1].show_frame
    path.write_text(
        f"site: moved.geojson\nshow_frame: {{latitude_deg: {frame.latitude_deg}, longitude_deg:"
        f" {frame.longitude_deg}, altitude_amsl_m: 488.0, heading_deg: {frame.heading_deg}}}\n"
        "links: [{name: a, listen: 'udpin://127.0.0.1:14540', vehicles: {count: 4}}]\n"
        "formation: {radius_m: 6.0, height_m: 15.0}\n"
        "target: {x_m: 0.0, y_m: -40.0}\n"
    )
    report = tmp_path / "report.json"
    assert main(["report", str(flown[0]), "--config", str(path), "--report", str(report)]) == 1
    checks = json.loads(report.read_text())["checks"]
    (areas,) = [check for check in checks if check["name"] == "beyond an area of the fence"]
    assert areas["kept"] is False
    assert areas["worst"] > 1.0
    assert areas["vehicle"] in flown[1].ids
