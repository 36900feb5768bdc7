"""Base of all transports: identity, addresses, conflicts, counters and recording."""

from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Protocol

from gcs.links.address_book import Address
from gcs.links.counters import Counters
from gcs.links.link import ParameterValue
from gcs.links.parameter_updates import ParameterNews
from gcs.links.tlog import Recorder
from gcs.links.vehicle_ids import check
from gcs.model.state import VehicleId


class Whereabouts(Protocol):
    """Addresses and address conflicts of systems."""

    def conflicts(self) -> Mapping[int, str]:
        """System ids with recent frames from two addresses, both named in the text."""
        ...

    def address(self, system_id: int) -> Address | None:
        """Source of this system's newest frame; None before the first."""
        ...


class BaseLink:
    """The part of `gcs.links.Link` that reports. Used on the loop's thread."""

    def __init__(
        self,
        name: str,
        vehicles: Mapping[VehicleId, int],
        whereabouts: Whereabouts,
        counters: Counters,
        recorder: Recorder | None,
    ) -> None:
        """Raises: InvalidError for a system id out of range or used twice."""
        check(vehicles)
        self._name = name
        self._vehicles = MappingProxyType(dict(vehicles))
        self._ids = tuple(vehicles)
        self._whereabouts = whereabouts
        self._counters = counters
        self._recorder = recorder
        self._parameter_news = ParameterNews()

    @property
    def name(self) -> str:
        """The name in the configuration."""
        return self._name

    @property
    def ids(self) -> tuple[VehicleId, ...]:
        """The vehicles configured on this link, whether connected or not."""
        return self._ids

    @property
    def problems(self) -> Sequence[str]:
        """See `Link.problems`."""
        problem = "" if self._recorder is None else self._recorder.problem
        return (f"link {self._name}: {problem}",) if problem else ()

    @property
    def conflicts(self) -> Mapping[VehicleId, str]:
        """Vehicles whose system id has recent frames from two addresses: both named in the text."""
        texts = self._whereabouts.conflicts()
        if not texts:
            return {}
        return {name: texts[system_id] for name, system_id in self._vehicles.items() if system_id in texts}

    @property
    def setpoints_sent(self) -> int:
        """Total of setpoints sent."""
        return self._counters.setpoints_sent

    @property
    def addresses(self) -> Mapping[VehicleId, Address]:
        """Source of each vehicle's newest frame: all that a kill from another process needs."""
        known = {name: self._whereabouts.address(system_id) for name, system_id in self._vehicles.items()}
        return {name: address for name, address in known.items() if address is not None}

    def watch_parameters(self, names: Collection[str]) -> None:
        """See `Link.watch_parameters`."""
        self._parameter_news.watch(names)

    def reported_parameters(self) -> Mapping[VehicleId, Mapping[str, ParameterValue]]:
        """See `Link.reported_parameters`."""
        return self._parameter_news.drain()

    @property
    def counters(self) -> Counters:
        """Totals since the link was created: setpoints sent, setpoints dropped by the watchdog, and so on."""
        return self._counters
