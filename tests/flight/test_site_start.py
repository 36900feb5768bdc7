"""A start of several stations: refused until each has reported that its vehicles are ready."""

import pytest

from gcs.model.errors import RefusedError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service import CommandRecord, ShowAction
from gcs.testing.virtual_site import SiteShow, fly_site, site_config

BUS = {"delay_s": 0.02, "spread_s": 0.01, "loss": 0.01}


async def asked_until_s(
    show: SiteShow, seconds: float, at_unix_time_s: float | None = None
) -> tuple[CommandRecord | None, list[str]]:
    """Ask for a start 20 times a second. Returns: the command once accepted, and the reasons until then."""
    reasons: list[str] = []
    for _ in range(round(20 * seconds)):
        try:
            command = show["north"].service.commands.command_show
            return command(ShowAction.START, at_unix_time_s=at_unix_time_s), reasons
        except RefusedError as refused:
            reasons.append(str(refused))
        await show.wait(0.05)
    return None, reasons


@pytest.mark.soak
def test_start_waits_until_every_station_has_reported() -> None:
    async def story(show: SiteShow) -> None:
        show.network.cut({"north", "south"}, {"west"})
        record, reasons = await asked_until_s(show, 15.0)
        assert record is None
        needs = "a start needs every station: station"
        assert reasons[0] == f"{needs} south is not received"
        assert f"{needs} south: it has not reported yet whether its vehicles are ready" in reasons
        assert reasons[-1] == f"{needs} west is not received"
        show.network.cut()
        record, reasons = await asked_until_s(show, 10.0)
        assert reasons[0] == f"{needs} west is not received"
        assert f"{needs} west: it has not reported yet whether its vehicles are ready" in reasons
        assert not show.armed.any()
        assert record is not None
        assert len(record.outcomes) == 6
        await show.reach(ShowPhase.RUNNING)
        assert [show.in_phase(name, Phase.FORMATION) for name in show.stations] == [2, 2, 2]

    fly_site(story, site_config(3, 2), **BUS)
