"""Stations on hosts of their own: network namespaces, with TLS between the stations."""

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from tests.support.machine import free_ports
from tests.support.netns import Hosts, Inside, hosts
from tests.support.processes import SOON_S
from tests.support.site_processes import NAMES, SiteProcesses, fleet_words, site_config
from tests.support.started import DEVNULL, Started, run

LEFT, RIGHT = NAMES[:2], NAMES[2:]


class SiteHosts(SiteProcesses):
    """Running stations on hosts of their own, each with its vehicles on its own loopback."""

    hosts: Hosts

    def start_vehicles(self, at: int) -> Started:
        """Start the fake vehicles of one station, by its place."""
        link, base = self.config.links[at], self.config.links[0].listen[0].rpartition(":")[2]
        each, truth = len(link.fleet), self.folder / f"truth-{link.name}.jsonl"
        words = (*fleet_words(self.config, at * each, each), "--port-base", base)
        namespace = self.hosts.namespace(link.name)
        self.truths.append(truth)
        return Started("gcs", "sim", *words, "--truth", str(truth), stdout=DEVNULL, namespace=namespace)


def ended(vehicles: Started) -> None:
    """End a process that stops with SIGTERM."""
    vehicles.terminate()
    vehicles.wait(SOON_S)


@contextmanager
def running_hosts(folder: Path, each: int = 3) -> Iterator[SiteHosts]:
    """Run four stations on four hosts, with keys of `gcs key site`, until the block ends."""
    with ExitStack() as stack:
        network = stack.enter_context(hosts(f"{os.getpid()}", LEFT, RIGHT))
        addresses = [network.addresses[name] for name in NAMES]
        keys = folder / "keys"
        config = site_config(len(NAMES), each, free_ports(4 * len(NAMES)), hosts=addresses, keys=keys)
        site = SiteHosts(config, folder)
        site.hosts = network
        made = run("gcs", "key", "site", str(keys), "--config", str(site.file), timeout_s=SOON_S)
        assert made.returncode == 0, made.stdout + made.stderr
        for at in range(len(NAMES)):
            stack.callback(ended, site.start_vehicles(at))
        stack.callback(site.end)
        for name in NAMES:
            reach = Inside(network.namespace(name))
            stack.callback(reach.end)
            site.start_station(name, reach=reach, namespace=network.namespace(name))
        yield site
