"""Zenoh's configuration of a station: fixed endpoints, no discovery, bounded queues, and with keys TLS."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import zenoh

from gcs.bus.interface import CONNECTION_S, PAYLOAD_MAX
from gcs.bus.settings import Endpoint, key_files
from gcs.model.errors import LinkError

ROOT: Final = "gcs"
"""Keys begin with `gcs/STATION`; a station may publish only its own."""

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


def configuration(
    station: str, endpoints: Mapping[str, Endpoint], keys: Path | None, listens: Endpoint | None = None
) -> zenoh.Config:
    """Zenoh's configuration of one station of the site. Raises: LinkError when a file of keys is missing.

    `listens` is where Zenoh listens if it is not at the station's endpoint.

    Of each pair of stations the first by name connects. If both do, a connection that one makes anew joins
    what the other has not closed yet, and no message arrives again (Zenoh's issue 2806).
    """
    tls = keys is not None
    config = zenoh.Config()
    values: dict[str, object] = {
        "mode": "peer",
        "listen/endpoints": [
            (listens or endpoints[station]).url(tls=tls) + f"#tls_handshake_timeout_ms={HANDSHAKE_MS}" * tls
        ],
        "connect/endpoints": [
            endpoint.url(tls=tls) for name, endpoint in endpoints.items() if name > station
        ],
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
