"""Two hosts on one radio network, in network namespaces: north flies the vehicles, south is its standby."""

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from gcs.config.schema import Config
from tests.support.machine import free_ports
from tests.support.netns import Inside, hosts
from tests.support.processes import SOON_S, wait_until
from tests.support.radio_network import Sent, sent
from tests.support.site_hosts import ended
from tests.support.site_processes import SiteProcesses, fleet_words, site_config
from tests.support.started import DEVNULL, Started, run

OWNER, STANDBY, RADIO = "north", "south", "radio"


def standby_config(
    vehicles: int, port_base: int, addresses: dict[str, str], keys: Path, *, rejoins: bool
) -> Config:
    """North flies so many vehicles, and south stands by for them; `rejoins`: it flies on by itself."""
    theirs = [addresses[OWNER], addresses[STANDBY]]
    raw = site_config(2, vehicles // 2, port_base, hosts=theirs, keys=keys).model_dump()
    link, (owner, standby) = raw["links"][0], raw["stations"]
    port = link["listen"][0].rpartition(":")[2]
    link |= {"listen": f"udpin://{theirs[0]}:{port}"}
    link["vehicles"] |= {"count": vehicles}
    mirror = {"link": link["name"], "listen": f"udpin://{theirs[1]}:{port}"}
    raw["links"], raw["stations"] = [link], [owner, standby | {"links": [], "standby": [mirror]}]
    raw["bus"]["standby_rejoins"] = rejoins
    return Config.model_validate(raw)


class StandbyHosts(SiteProcesses):
    """The two running stations, their vehicles, and what crossed the radio network."""

    @property
    def frames(self) -> Path:
        return self.folder / "frames.bin"

    def sent(self, station: str) -> list[Sent]:
        """Setpoints and commands of a station as they crossed the radio network."""
        return [one for one in sent(self.frames) if one.station == self.names.index(station)]

    def own_phases(self, name: str) -> list[str]:
        """Phases of the vehicles that a station flies now."""
        fleet = self.at(name, lambda client: client.fleet())
        return [one.phase for one in fleet.vehicles if one.station == name]

    def all_form(self, *names: str) -> bool:
        """Whether all vehicles fly in formation, at whichever of these stations."""
        phases = [phase for name in names or self.left for phase in self.own_phases(name)]
        return phases == ["formation"] * len(self.config.ids)

    def owned_by_standby(self) -> bool:
        """Whether the standby flies all vehicles, as its API has it."""
        return len(self.own_phases(STANDBY)) == len(self.config.ids)


@contextmanager
def running_standby(folder: Path, vehicles: int, *, rejoins: bool) -> Iterator[StandbyHosts]:
    """Run vehicles, radio network and both stations until the block ends."""
    with ExitStack() as stack:
        network = stack.enter_context(hosts(f"{os.getpid()}", (OWNER, RADIO), (STANDBY,)))
        keys = folder / "keys"
        config = standby_config(vehicles, free_ports(8), network.addresses, keys, rejoins=rejoins)
        site = StandbyHosts(config, folder)
        made = run("gcs", "key", "site", str(keys), "--config", str(site.file), timeout_s=SOON_S)
        assert made.returncode == 0, made.stdout + made.stderr
        port = config.links[0].listen[0].rpartition(":")[2]
        radio, truth = network.namespace(RADIO), folder / "truth.jsonl"
        site.truths.append(truth)
        words = (port, str(site.frames), network.addresses[RADIO])
        both = [f"{network.addresses[name]}:{port}" for name in site.names]
        carrier = Started("tests.support.radio_network", *words, *both, stdout=DEVNULL, namespace=radio)
        stack.callback(ended, carrier)
        wait_until("radio network", SOON_S, site.frames.exists)
        flown = (*fleet_words(config, 0, vehicles), "--port-base", port, "--truth", str(truth))
        fleet = Started("gcs", "sim", *flown, stdout=DEVNULL, namespace=radio)
        stack.callback(ended, fleet)
        stack.callback(site.end)
        for name in site.names:
            reach = Inside(network.namespace(name))
            stack.callback(reach.end)
            site.start_station(name, reach=reach, namespace=network.namespace(name))
        yield site
