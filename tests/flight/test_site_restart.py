"""A station that was started again in mid-flight: any station settles its interrupted flight."""

from pathlib import Path

import pytest

from gcs.model.errors import RefusedError
from gcs.model.interrupted_flight import Before, Interruption, Offer
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.recording.session import Record
from gcs.service import Outcome
from gcs.testing.virtual_site import SiteShow, VirtualStation, fly_site, site_config
from tests.flight.test_site_api import BUS, call


def record_of(station: VirtualStation, folder: Path) -> Record:
    """A record: its newest session ended while all vehicles of the station were in formation."""
    rows, config = station.view.rows, station.config
    vehicles = {}
    for number, name in enumerate(config.ids, 1):
        home_m = rows.homes_m[rows.ids.index(name)]
        assert home_m is not None
        pad_m = float(home_m[0]), float(home_m[1]), float(home_m[2])
        vehicles[name] = Before(number, Phase.FORMATION, "", pad_m)
    frame = config.show_frame.model_dump()
    plan = {"time_s": 0.0}
    found = Interruption("before", station.unix(), ShowPhase.RUNNING, "", frame, vehicles, None, plan)
    links = {name: (one.system_id, "loop") for name, one in vehicles.items()}
    return Record(folder, config.model_dump_json(), links, flight=False, interruption=found)


@pytest.mark.soak
def test_any_station_brings_home_what_another_was_flying(tmp_path: Path) -> None:
    async def story(show: SiteShow) -> None:
        with pytest.raises(RefusedError, match="no flight was cut off"):
            show["north"].service.recovery.settle(Offer.BRING_HOME)
        await show.start()
        south, north = show["south"], show["north"].service
        await south.kill()
        await show.wait(4.0)
        with record_of(south, tmp_path) as record:
            south.restart(record)
            await show.wait(4.0)
            listed = {each["name"]: each for each in await call(show, "north", "GET", "/stations")}
            assert listed["south"]["offers"] == ["bring-home"]
            with pytest.raises(RefusedError, match="no flight was cut off"):
                north.recovery.settle(Offer.TAKE_OVER)
            asked = await call(show, "north", "POST", "/show/bring-home")
            assert set(asked["outcomes"]) == {"s1", "s2"}
            await show.until(lambda: south.view.show is ShowPhase.RETURNING, 10.0)
            whole = await show.settled("north", north.command_log.get(asked["id"]))
            assert {name: one.outcome for name, one in whole.outcomes.items()} == dict.fromkeys(
                ("s1", "s2"), Outcome.DONE
            )
            assert south.service.command_log.newest()[-1].action == "bring-home"
        assert show.violations == 0

    fly_site(story, site_config(2, 2), **BUS)
