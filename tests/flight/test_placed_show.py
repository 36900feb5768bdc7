"""A drawn show is fitted to the vehicles as they stand, in any order, and passes preflight there."""

from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

from gcs.config.schema import Config
from gcs.model.lifecycle import ShowPhase
from gcs.model.preflight_report import PreflightReport
from gcs.service import ShowAction
from gcs.shows import load, parse
from gcs.shows.formats import read_drawing, write_drawing
from gcs.shows.importing import show_text
from gcs.shows.placement import fence_m, fitted, place_of, placed_text, placement
from gcs.simulation.drawn_traffic import ORIGIN
from gcs.simulation.rehearsal import rehearse
from gcs.simulation.verdict import judge
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, VirtualShow, fly, show_config
from tests.support.drawn_shows import drawn_show

COUNT, SPACING_M, TURN_DEG = 8, 6.0, 25.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shows")
    write_drawing(drawn_show(COUNT, 30.0, SPACING_M, ("rings",)), folder / "night.skyc")
    drawing, data = read_drawing(folder / "night.skyc")
    (folder / "night.yaml").write_text(show_text(drawing, "night.skyc", sha256(data).hexdigest()))
    return folder


def config(folder: Path) -> Config:
    """The fleet's first vehicle has the last system id: it stands on the last pad."""
    frame = {
        "latitude_deg": ORIGIN.latitude_deg,
        "longitude_deg": ORIGIN.longitude_deg,
        "altitude_amsl_m": ORIGIN.altitude_amsl_m,
        "heading_deg": ORIGIN.heading_deg,
    }
    vehicles = [{"id": f"v{number}", "system_id": number} for number in range(COUNT, 0, -1)]
    links = [{"name": "loop", "listen": "udpin://127.0.0.1:14540", "vehicles": vehicles}]
    shown = show_config(COUNT, shows={"folder": folder}, show_frame=frame, operation=HOLDS_WHEN_LOST)
    return Config.model_validate(shown.model_dump() | {"links": links})


def standing(folder: Path) -> dict[str, Any]:
    """Settings of a fake fleet beside the drawing, turned."""
    pads = load(folder / "night.yaml").show.fleet.pads
    heading_deg = ORIGIN.heading_deg + TURN_DEG
    return {
        "spacing_m": pads.spacing_m,
        "grid_columns": pads.columns,
        "grid_heading_deg": heading_deg,
        "grid_at_m": (9.0, -14.0),
    }


@pytest.mark.soak
def test_a_show_fitted_to_its_vehicles_is_ready_and_flies(folder: Path) -> None:
    async def story(show: VirtualShow) -> tuple[PreflightReport, PreflightReport, float]:
        await show.standby()
        path = folder / "night.yaml"
        _, before = select(show, path)
        loaded = load(path)
        rows = show.view.rows
        place = fitted(loaded.show, placement(0.0, 0.0, 0.0), rows.position_m[:, :2])
        assert loaded.drawing is not None
        fence = fence_m(loaded.show, loaded.drawing, place)
        path.write_text(placed_text(loaded.source, path.read_text(), loaded.show, fence, place, ORIGIN))
        show_hash, after = select(show, path)
        show.service.commands.command_show(ShowAction.START, show_hash=show_hash)
        await show.reach(ShowPhase.RUNNING, 90.0)
        await show.reach(ShowPhase.LANDED, 240.0)
        assert show.floor_violations() == 0
        return before, after, place_of(load(path).show).turn_deg

    before, after, turn_deg = fly(story, config(folder), **standing(folder))
    assert turn_deg == pytest.approx(TURN_DEG, abs=1.5)
    assert not pattern(before)
    assert any("gcs shows place night --fit yes" in check.to_do for check in before.fleet)
    assert pattern(after), after
    assert all(check.passes for one in after.vehicles for check in one.checks if check.name == "place")


def select(show: VirtualShow, path: Path) -> tuple[str, PreflightReport]:
    """Check and select the show in a file. Returns: its hash, and what a start would find."""
    text = path.read_text()
    loaded = parse(text, str(path))
    answer = asdict(judge(rehearse(loaded))) | {"model": loaded.show.model_dump(mode="json")}
    reported = show.service.shows.found("night", text.encode(), answer)
    assert reported.good, reported.problems
    assert reported.hash is not None
    show.service.player.select("night", reported.hash)
    return reported.hash, show.service.preflight.report()


def pattern(report: PreflightReport) -> bool:
    """Whether the vehicles stand where the show has its pads."""
    checks = [check for check in report.fleet if "start pattern" in check.name]
    assert checks
    return all(check.passes for check in checks)
