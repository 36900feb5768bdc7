"""Parameter values that vehicles announce without a request.

PX4 answers each PARAM_SET with a PARAM_VALUE to all. Used on the loop's thread.
"""

from collections.abc import Collection, Mapping

from gcs.links.link import ParameterValue
from gcs.model.state import VehicleId


class ParameterNews:
    """Keeps the newest value of each watched parameter until it is read: bounded by their number."""

    def __init__(self) -> None:
        self._names: frozenset[str] = frozenset()
        self._news: dict[VehicleId, dict[str, ParameterValue]] = {}

    def watch(self, names: Collection[str]) -> None:
        """Watch these parameters from now on, and no others."""
        self._names = frozenset(names)

    def take(self, vehicle_id: VehicleId, name: str, value: ParameterValue) -> None:
        """Record a value that a vehicle has announced."""
        if name in self._names:
            self._news.setdefault(vehicle_id, {})[name] = value

    def drain(self) -> Mapping[VehicleId, Mapping[str, ParameterValue]]:
        """The values announced since the last call."""
        news, self._news = self._news, {}
        return news
