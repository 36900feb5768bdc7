"""The bus over Eclipse Zenoh: peers with fixed endpoints, no discovery (decision 0045).

Stations on one machine read each other's messages in shared memory (decision 0053): Zenoh then carries only
which stations are present. Needs the extra `stations`.
"""

import asyncio
import logging
import os
import socket
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Final, TypeAlias

import zenoh

from gcs.bus.bundles import bundles, parts_of
from gcs.bus.gate import Gate
from gcs.bus.interface import Accepts, BusCounters, Received, anything
from gcs.bus.settings import Endpoint
from gcs.bus.shared_memory import BundleReader, Writer, shared_file
from gcs.bus.zenoh_config import ROOT, configuration, threads
from gcs.links.intake import Intake
from gcs.model.errors import LinkError

log = logging.getLogger(__name__)

ALIVE: Final = "alive"
"""Below a station's name: its liveliness token; the last event of it counts."""

BUNDLES: Final = "bundles"
"""Below a station's name: its messages."""

LOOPBACK: Final = "127.0.0.1"

KEPT: Final = 256
"""Bundles of one station that wait for the next tick; beyond that the oldest are dropped.

At 5 ticks a second or more, 1,000 a second of a stranger in a station's name drop none of the station's own.
"""

_Samples: TypeAlias = "zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]"


class _Open:
    """An open session, with what is declared on it."""

    def __init__(
        self, session: zenoh.Session, station: str, others: list[str], writer: Writer | None
    ) -> None:
        self.changes: deque[tuple[str, bool]] = deque()  # stations that came or went, by Zenoh's threads
        self._writer = writer
        self._readers: dict[str, BundleReader] = {}  # of stations that share memory with this one
        self._bundles: dict[str, _Samples] = {}  # of the rest
        self._session = session
        liveliness = session.liveliness()
        for name in others:
            self._subscribe(name)
        alive = {name: partial(self._note_presence, name) for name in others}
        self._tokens = [
            liveliness.declare_subscriber(f"{ROOT}/{name}/{ALIVE}", note, history=True)
            for name, note in alive.items()
        ]
        self._token = liveliness.declare_token(f"{ROOT}/{station}/{ALIVE}")
        self._publisher = session.declare_publisher(
            f"{ROOT}/{station}/{BUNDLES}",
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )
        self._subscribed = True  # by a station that does not share memory, as far as is known
        self._listener = self._publisher.declare_matching_listener(self._note_subscribed)

    def _note_presence(self, name: str, sample: zenoh.Sample) -> None:
        self.changes.append((name, sample.kind == zenoh.SampleKind.PUT))

    def _note_subscribed(self, status: zenoh.MatchingStatus) -> None:
        self._subscribed = status.matching

    def publish(self, bundle: bytes) -> None:
        if self._writer is not None:
            self._writer.put(bundle)
        if self._subscribed:
            self._publisher.put(bundle)

    def _subscribe(self, name: str) -> None:
        ring: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(KEPT)
        self._bundles[name] = self._session.declare_subscriber(f"{ROOT}/{name}/{BUNDLES}", ring)

    def read_memory(self, name: str, file: Path) -> None:
        """Read a station's messages in memory from now on, where it shares it: Zenoh then sends none."""
        if (before := self._readers.pop(name, None)) is not None:
            before.close()
        try:
            self._readers[name] = BundleReader(file)
        except LinkError as error:
            log.warning("memory_not_shared", extra={"other": name, "cause": str(error)})
            if name not in self._bundles:
                self._subscribe(name)
        else:
            if (subscriber := self._bundles.pop(name, None)) is not None:
                subscriber.undeclare()  # type: ignore[no-untyped-call]

    def newest(self) -> Iterator[tuple[str, bytes]]:
        """Sender and bundle of all that has arrived."""
        for sender, reader in self._readers.items():
            for bundle in reader.newest():
                yield sender, bundle
        for sender, subscriber in self._bundles.items():
            for _ in range(KEPT):  # a flood does not keep this loop going
                sample = subscriber.try_recv()
                if sample is None:
                    break
                yield sender, sample.payload.to_bytes()

    def close(self) -> None:
        """Close what a session does not."""
        for reader in self._readers.values():
            reader.close()
        if self._writer is not None:
            self._writer.close()


class ZenohBus:
    """One station's end. Implements `Bus`."""

    def __init__(
        self,
        station: str,
        endpoints: Mapping[str, Endpoint],
        *,
        keys: Path | None,
        now_s: Callable[[], float],
    ) -> None:
        """Opens nothing before `run`.

        Args:
            station: its name.
            endpoints: of all stations of the site, this one among them.
            keys: the folder of `make_site_keys`; None: no TLS, for loopback only.
            now_s: the loop's clock.
        """
        self.station = station
        self.counters = BusCounters()
        self.accepts: Accepts = anything
        self._endpoints, self._keys = dict(endpoints), keys
        self._now_s = now_s
        self._open: _Open | None = None
        self._gate: Gate | None = None  # where strangers may connect
        self._present: set[str] = set()

    async def run(self) -> None:
        here = self._endpoints[self.station]
        os.environ.setdefault("ZENOH_RUNTIME", threads(len(self._endpoints)))
        try:
            # Zenoh's threads inherit the priority of the one that opens it. Below control's, they would wait
            # for the control of every station on this machine.
            opener = ThreadPoolExecutor(1, thread_name_prefix="bus")
            try:
                opening = asyncio.get_running_loop().run_in_executor(opener, self._opened)
                session, self._gate = await opening
            finally:
                opener.shutdown(wait=False)
        except (zenoh.ZError, OSError) as error:
            raise LinkError(f"the bus does not open at {here.host}:{here.port}: {error}") from None
        try:
            others = [name for name in self._endpoints if name != self.station]
            self._open = _Open(session, self.station, others, self._writer())
            await asyncio.Event().wait()
        finally:
            if self._open is not None:
                self._open.close()
            self._open = None
            self._present.clear()
            gate, self._gate = self._gate, None
            if gate is not None:
                await asyncio.to_thread(gate.close)
            await asyncio.to_thread(session.close)

    def _opened(self) -> tuple[zenoh.Session, Gate | None]:
        """Open Zenoh, behind a gate where it has keys. Raises: ZError, OSError, LinkError."""
        if self._keys is None:
            return zenoh.open(configuration(self.station, self._endpoints, None)), None
        others = {name: endpoint for name, endpoint in self._endpoints.items() if name != self.station}
        gate = Gate(self._endpoints[self.station], others)
        with ExitStack() as failed:
            failed.callback(gate.close)
            with socket.create_server((LOOPBACK, 0)) as free:
                inner = Endpoint(host=LOOPBACK, port=free.getsockname()[1])
            session = zenoh.open(configuration(self.station, self._endpoints, self._keys, inner))
            gate.start((inner.host, inner.port))
            failed.pop_all()
        return session, gate

    def _writer(self) -> Writer | None:
        """None: no other station can be on this machine, or it cannot share memory with them."""
        here = self._endpoints[self.station]
        if not here.is_loopback:
            return None
        try:
            return Writer(shared_file(here))
        except LinkError as error:
            log.warning("memory_not_shared", extra={"other": self.station, "cause": str(error)})
            return None

    def publish(self, messages: Mapping[str, bytes]) -> None:
        made = list(bundles(messages))
        if self._open is None:
            return
        for bundle in made:
            self._open.publish(bundle)
            self.counters.sent_bytes += len(bundle)
        self.counters.sent += len(messages)

    def newest(self) -> list[Received]:
        if self._open is None:
            return []
        received: dict[tuple[str, str], Received] = {}
        now_s = self._now_s()
        for sender, bundle in self._open.newest():
            try:
                parts = parts_of(bundle)
            except LinkError:
                self.counters.refused += 1
                continue
            for topic, payload in parts:
                if not self.accepts(topic, payload):
                    self.counters.refused += 1
                    continue
                self.counters.received += 1
                received[sender, topic] = Received(sender, topic, payload, now_s)
        return list(received.values())

    @property
    def intakes(self) -> Sequence[Intake]:
        return () if self._gate is None else (self._gate.failures,)

    @property
    def present(self) -> frozenset[str]:
        while self._open is not None and self._open.changes:
            name, came = self._open.changes.popleft()
            if not came:
                self._present.discard(name)
                continue
            self._present.add(name)
            there = self._endpoints[name]
            if self._endpoints[self.station].is_loopback and there.is_loopback:
                self._open.read_memory(name, shared_file(there))
        return frozenset(self._present)
