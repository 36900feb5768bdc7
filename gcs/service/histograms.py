"""Histograms of the ticks, for the metrics, in this process or in another one."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from prometheus_client import Histogram, Metric


@dataclass(frozen=True, slots=True, eq=False)
class Collected:
    """What a histogram had counted when it was pickled."""

    metrics: Sequence[Metric]

    def collect(self) -> Sequence[Metric]:
        return self.metrics


class TickHistogram(Histogram):
    """A histogram outside any registry; another process receives what it has counted."""

    def __init__(self, name: str, text: str, bounds_s: Sequence[float]) -> None:
        super().__init__(name, text, buckets=bounds_s, registry=None)

    def __reduce__(self) -> tuple[Any, ...]:
        return Collected, (tuple(self.collect()),)
