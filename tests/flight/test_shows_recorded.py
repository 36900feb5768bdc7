"""A written show leaves its own fence and its lights in the record, and is judged by them."""

import json
from pathlib import Path

import numpy as np
import pytest

from gcs.cli.main import main
from gcs.model.lifecycle import ShowPhase
from gcs.recording import mcap_layout as layout
from gcs.recording.audit_reader import last_known
from gcs.recording.mcap_reader import FlightData
from gcs.recording.session import Record
from gcs.service import ShowAction
from gcs.testing.virtual_show import VirtualShow
from tests.support.written_show import config, fly, select

ALL = ("d1", "d2", "d3", "d4")


@pytest.mark.soak
def test_a_show_is_recorded_with_its_fence_and_its_lights(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = config(tmp_path / "shows", record={"folder": tmp_path / "runs"})
    (tmp_path / "shows").mkdir()
    service_m = plan.control.safety.fence.distance_max_m

    async def story(show: VirtualShow) -> None:
        await show.standby()
        show_hash = select(show)
        show.service.commands.command_show(ShowAction.START, ALL, show_hash=show_hash)
        await show.reach(ShowPhase.RUNNING)
        await show.wait(4.0)
        await show.show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED)

    vehicles = {name: (row + 1, "loop") for row, name in enumerate(plan.ids)}
    with Record(tmp_path / "runs", plan.model_dump_json(), vehicles) as record:
        fly(story, plan, record=record)
        assert record.problems == ()
    session = last_known(tmp_path / "runs").session
    assert session is not None
    file = session.folder / "flight.mcap"
    ticks = list(FlightData(file).ticks())
    fences_m = [tick.status.limits.safety["fence"]["distance_max_m"] for tick in ticks if tick.status.limits]
    assert (fences_m[0], fences_m[-1]) == (service_m, 100.0)
    assert service_m > 100.0
    running = [tick for tick in ticks if tick.status.show == "running"]
    colour, lit = layout.colours(running[20].vehicles)
    assert lit.all()
    np.testing.assert_array_equal(colour, [[255, 0, 0], [0, 0, 255], [255, 0, 0], [0, 0, 255]])
    assert not layout.colours(ticks[0].vehicles)[1].any()
    capsys.readouterr()
    code = main(["report", str(file), "--json"])
    report = json.loads(capsys.readouterr().out)
    (farthest,) = [each for each in report["checks"] if each["name"] == "greatest distance"]
    assert (code, report["verdict"], farthest["limit"]) == (0, "kept", 100.0), report["missing"]
