"""The bus over Eclipse Zenoh: peers with fixed endpoints, no discovery (decision 0045).

Needs the extra `stations`.
"""

import asyncio
import json
import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final, TypeAlias

import zenoh

from gcs.bus.bundles import bundles, parts_of
from gcs.bus.interface import CONNECTION_S, PAYLOAD_MAX, Accepts, BusCounters, Received, anything
from gcs.bus.settings import Endpoint, key_files
from gcs.model.errors import LinkError

ROOT: Final = "gcs"
"""Keys begin with `gcs/STATION`; a station may publish only its own."""

ALIVE: Final = "alive"
"""Below a station's name: its liveliness token; the last event of it counts."""

BUNDLES: Final = "bundles"
"""Below a station's name: its messages."""

KEPT: Final = 256
"""Bundles of one station that wait for the next tick; beyond that the oldest are dropped.

At 5 ticks a second or more, 1,000 a second of a stranger in a station's name drop none of the station's own.
"""

MESSAGE_MAX: Final = PAYLOAD_MAX + 4000
"""Bytes of a message with its key: it fits into one batch of Zenoh, and larger ones are not put together."""

BURST: Final = 16
"""Messages to one station that wait for its socket; the most that Zenoh allows."""

RETRY: Final = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2}
"""Of connecting: a bus that was cut heals within half a second."""

HANDSHAKE_MS: Final = 2000
"""Limit of one attempt to connect: closing waits for it, and so does the next attempt."""


CLOSING: Final = ("rx", "net", "acc")
"""Zenoh's runtimes with threads that close connections."""


def threads(stations: int) -> str:
    """Zenoh's setting of its threads, for the environment.

    Closing the connection to a host that has vanished holds a thread for 10 s (Zenoh's issues 2718 and 1101):
    with one thread each, as is the default, all other stations are silent for as long. The runtime that sends
    closes none, and has one thread: of several, each message wakes two.
    """
    many = dict.fromkeys(CLOSING, 2 * stations) | {"tx": 1}
    return f"({', '.join(f'{name}: (worker_threads: {count})' for name, count in many.items())})"


def configuration(station: str, endpoints: Mapping[str, Endpoint], keys: Path | None) -> zenoh.Config:
    """Zenoh's configuration of one station of the site. Raises: LinkError when a file of keys is missing.

    Of each pair of stations the first by name connects. If both do, a connection that one makes anew joins
    what the other has not closed yet, and no message arrives again (Zenoh's issue 2806).
    """
    tls = keys is not None
    config = zenoh.Config()
    values: dict[str, object] = {
        "mode": "peer",
        "listen/endpoints": [endpoints[station].url(tls=tls)],
        "connect/endpoints": [one.url(tls=tls) for name, one in endpoints.items() if name > station],
        "connect/timeout_ms": -1,  # go on connecting, and
        "connect/exit_on_failure": False,  # do it in the background
        "connect/retry": RETRY,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/protocols": ["tls" if tls else "tcp"],
        "transport/link/tx/lease": round(1000 * CONNECTION_S),  # four times as long as between keep-alives
        "transport/link/tx/queue/size/real_time": BURST,
        "transport/link/rx/max_message_size": MESSAGE_MAX,
        "transport/unicast/open_timeout": HANDSHAKE_MS,
        "transport/unicast/accept_timeout": HANDSHAKE_MS,
        "transport/unicast/max_sessions": 4 * len(endpoints) + 16,
        "transport/shared_memory/enabled": False,
    }
    if keys is not None:
        authority, certificate, key = key_files(keys, station)
        for file in (authority, certificate, key):
            if not file.is_file():
                raise LinkError(f"{file} is missing: gcs key site makes it")
        values |= {
            "transport/link/tls/root_ca_certificate": str(authority),
            "transport/link/tls/listen_certificate": str(certificate),
            "transport/link/tls/listen_private_key": str(key),
            "transport/link/tls/connect_certificate": str(certificate),
            "transport/link/tls/connect_private_key": str(key),
            "transport/link/tls/enable_mtls": True,
            "access_control": _access(list(endpoints)),
        }
    for name, value in values.items():
        config.insert_json5(name, json.dumps(value))
    return config


def _access(stations: list[str]) -> dict[str, object]:
    """Each station, known by the name in its certificate, may publish its own keys only."""
    everything, sent = [f"{ROOT}/**"], ["put", "liveliness_token"]
    rules: list[dict[str, object]] = [
        {"id": f"of-{name}", "flows": ["ingress"], "messages": sent, "key_exprs": [f"{ROOT}/{name}/**"]}
        for name in stations
    ]
    rules.append({"id": "out", "flows": ["egress"], "messages": sent, "key_exprs": everything})
    asks = ["declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"]
    rules.append({"id": "ask", "flows": ["ingress", "egress"], "messages": asks, "key_exprs": everything})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule | {"permission": "allow"} for rule in rules],
        "subjects": [{"id": name, "cert_common_names": [name]} for name in stations],
        "policies": [{"rules": [f"of-{name}", "out", "ask"], "subjects": [name]} for name in stations],
    }


_Samples: TypeAlias = "zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]"


class _Open:
    """An open session, with what is declared on it."""

    def __init__(self, session: zenoh.Session, station: str, others: list[str]) -> None:
        self.bundles: dict[str, _Samples] = {}
        self.tokens: dict[str, _Samples] = {}
        liveliness = session.liveliness()
        for name in others:
            ring: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(KEPT)
            self.bundles[name] = session.declare_subscriber(f"{ROOT}/{name}/{BUNDLES}", ring)
            last: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(1)
            self.tokens[name] = liveliness.declare_subscriber(f"{ROOT}/{name}/{ALIVE}", last, history=True)
        self._token = liveliness.declare_token(f"{ROOT}/{station}/{ALIVE}")
        self.publisher = session.declare_publisher(
            f"{ROOT}/{station}/{BUNDLES}",
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )


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
        self._present: set[str] = set()

    async def run(self) -> None:
        config = configuration(self.station, self._endpoints, self._keys)
        here = self._endpoints[self.station]
        os.environ.setdefault("ZENOH_RUNTIME", threads(len(self._endpoints)))
        try:
            # Zenoh's threads inherit the priority of the one that opens it. Below control's, they would wait
            # for the control of every station on this machine.
            opener = ThreadPoolExecutor(1, thread_name_prefix="bus")
            try:
                opening = asyncio.get_running_loop().run_in_executor(opener, zenoh.open, config)
                session = await opening
            finally:
                opener.shutdown(wait=False)
        except zenoh.ZError as error:
            raise LinkError(f"the bus does not open at {here.host}:{here.port}: {error}") from None
        try:
            others = [name for name in self._endpoints if name != self.station]
            self._open = _Open(session, self.station, others)
            await asyncio.Event().wait()
        finally:
            self._open = None
            self._present.clear()
            await asyncio.to_thread(session.close)

    def publish(self, messages: Mapping[str, bytes]) -> None:
        made = list(bundles(messages))
        if self._open is None:
            return
        for bundle in made:
            self._open.publisher.put(bundle)
            self.counters.sent_bytes += len(bundle)
        self.counters.sent += len(messages)

    def newest(self) -> list[Received]:
        if self._open is None:
            return []
        found: dict[tuple[str, str], Received] = {}
        now_s = self._now_s()
        for sender, subscriber in self._open.bundles.items():
            for _ in range(KEPT):  # a flood does not keep this loop going
                sample = subscriber.try_recv()
                if sample is None:
                    break
                try:
                    parts = parts_of(sample.payload.to_bytes())
                except LinkError:
                    self.counters.refused += 1
                    continue
                for topic, payload in parts:
                    if not self.accepts(topic, payload):
                        self.counters.refused += 1
                        continue
                    self.counters.received += 1
                    found[sender, topic] = Received(sender, topic, payload, now_s)
        return list(found.values())

    @property
    def present(self) -> frozenset[str]:
        if self._open is not None:
            for name, subscriber in self._open.tokens.items():
                sample = subscriber.try_recv()
                if sample is not None and sample.kind == zenoh.SampleKind.PUT:
                    self._present.add(name)
                elif sample is not None:
                    self._present.discard(name)
        return frozenset(self._present)
