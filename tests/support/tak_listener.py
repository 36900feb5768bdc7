"""Reads what a show sends to TAK, with another parser than its own."""

from dataclasses import dataclass, field
from datetime import datetime
from xml.etree import ElementTree as ET

from gcs.flight.features.tak import TakTracks
from gcs.flight.orchestrator import Orchestrator
from gcs.links.tak.sender import CotSender
from gcs.links.tak.settings import TakReceiver


@dataclass(frozen=True)
class TakEvent:
    """One event, at a time of the show's clock."""

    now_s: float
    event: ET.Element

    def of(self, path: str, name: str) -> str:
        element = self.event if path == "." else self.event.find(path)
        return "" if element is None else element.get(name, "")

    @property
    def callsign(self) -> str:
        return self.of("detail/contact", "callsign")

    @property
    def place(self) -> tuple[float, float, float]:
        latitude, longitude, height = (float(self.of("point", name)) for name in ("lat", "lon", "hae"))
        return latitude, longitude, height

    def unix_s(self, name: str) -> float:
        return datetime.fromisoformat(self.of(".", name)).timestamp()


def read(event: bytes, now_s: float = 0.0) -> TakEvent:
    return TakEvent(now_s, ET.fromstring(event))  # noqa: S314  our own


class Listener(CotSender):
    """A receiver without a network."""

    def __init__(self) -> None:
        super().__init__(TakReceiver(at="udp://192.0.2.9:6969"))
        self.events: list[TakEvent] = []

    def offer(self, events: list[bytes], now_s: float) -> None:  # type: ignore[override]
        self.events += [read(event, now_s) for event in events]

    def times_s(self, callsign: str) -> list[float]:
        return [each.now_s for each in self.events if each.callsign == callsign]


@dataclass
class Listening:
    """The feature of a flight, with one receiver: a listener."""

    tak: TakTracks
    listener: Listener = field(default_factory=Listener)

    @staticmethod
    def to(service: Orchestrator) -> "Listening":
        (tak,) = [each for each in service.flight.features if isinstance(each, TakTracks)]
        listening = Listening(tak)
        tak.senders = [listening.listener]
        return listening
