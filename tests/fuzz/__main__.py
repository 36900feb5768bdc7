"""`python -m tests.fuzz --seconds 3600 --seed N`: random bytes at every input, while vehicles fly.

Real services over fake vehicles: first one with a link of each transport, corrections, timecode and a further
ground station; then a site of two stations, for the bus. Rounds of `ROUND_S` with nothing and with a random
choice of samples follow each other. What is found: a process that ended, an error in a log, vehicles that
left the formation or came too close, and rounds with more late ticks than the quiet ones of the run have.

Findings are printed as they are found, and one line of JSON at the end. Returns 1 if something was found.
"""

import argparse
import json
import random
import socket
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

import zenoh

from gcs.bus.bundles import parts_of
from gcs.bus.zenoh_bus import BUNDLES
from gcs.bus.zenoh_config import ROOT, configuration
from gcs.client import Client
from gcs.config.schema import Config
from gcs.model.errors import GcsError
from tests.fuzz import samples
from tests.fuzz.samples import Make
from tests.support.machine import Pauses, free_ports
from tests.support.processes import SOON_S, flying_config, proper, service, vehicles, wait_passes, wait_until
from tests.support.site_processes import Timing, Verdict, running_site, timing_of, verdict
from tests.support.started import Started

ROUND_S: Final = 10.0
PER_S: Final = (20.0, 200.0, 2000.0)
"""Of one input in a round: below and above its bound."""

MADE: Final = 200
"""Samples of a kind in a round."""

TRUE_ERRORS: Final = ('"event": "duplicate_system_id"',)
"""What a log says rightly: samples bear the numbers of the fleet, and come from elsewhere."""

OF_STRANGERS: Final = (*TRUE_ERRORS, '"cause": "too-close"')
"""The same of a bus without keys, where a stranger's vehicles are a station's. True states judge whether any
came too close.
"""

LATE_SHARE: Final = 0.02
TRANSPORTS: Final = ("native", "mavsdk")


@dataclass
class Input:
    """One input, and what may be sent there."""

    send: Callable[[bytes], object]
    makes: Mapping[str, Make]


@dataclass
class Flight:
    """Services in flight."""

    clients: Mapping[str, Client]
    processes: Mapping[str, Started]
    logs: Mapping[str, Path]
    inputs: Mapping[str, Input]
    flies_on: bool  # no input may end the show: strangers at a bus without keys speak as a station
    true_errors: tuple[str, ...]  # parts of lines of the log that are right
    judged: Callable[[], Verdict]  # by the true states

    def timings(self) -> dict[str, Timing]:
        return {name: timing_of(one.metrics(), 20.0) for name, one in self.clients.items()}


@dataclass
class Seen:
    """Of a whole run."""

    seed: int
    seconds: float
    rounds: int = 0
    sent: Counter[str] = field(default_factory=Counter)
    ticks: int = 0
    late: float = 0.0  # more than 10 ms, or missed, while something was sent
    quiet_ticks: int = 0
    quiet_late: float = 0.0
    paused_s: float = 0.0  # the machine, in these rounds
    found: list[str] = field(default_factory=list)


@contextmanager
def one_service(folder: Path) -> Iterator[Flight]:
    base, count = free_ports(7), 4
    raw = flying_config(count, base, silence_s=20.0).model_dump(mode="json")
    (link,) = raw["links"]
    raw["links"] = [
        link
        | {
            "name": transport,
            "transport": transport,
            "listen": f"udpin://127.0.0.1:{base + 2 * at}",
            "ports": 2,
            "vehicles": {"first_system_id": 2 * at + 1, "count": 2, "id_pattern": "d{system_id}"},
            "forward": [{"url": f"udp://127.0.0.1:{base + 6}", "read_only": False}] * (at == 0),
        }
        for at, transport in enumerate(TRANSPORTS)
    ]
    raw["scheduling"] = "real-time"  # as in operation: the machine's other work delays ticks less
    raw["rtk"] = {"source": f"udp://127.0.0.1:{base + 4}"}
    raw["timecode"] = {"source": f"udp-midi://127.0.0.1:{base + 5}"}
    config = Config.model_validate(raw)
    with ExitStack() as stack:
        words = ("--telemetry-hz", "10", "--battery", "600", *proper(config))  # no battery ends the run
        stack.enter_context(vehicles(count, base, folder, *words))
        client, process = stack.enter_context(service(config, folder / "record"))
        sender = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        far = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        far.bind(("127.0.0.1", base + 6))
        wait_passes(client)
        client.start()
        wait_until("running", SOON_S, lambda: client.show().phase == "running")
        back = far.recvfrom(4096)[1]

        def at(port: int) -> Callable[[bytes], object]:
            return lambda data: sender.sendto(data, ("127.0.0.1", port))

        frames = samples.mavlink()
        inputs = {
            **{f"mavlink-{one}": Input(at(base + 2 * row), frames) for row, one in enumerate(TRANSPORTS)},
            "rtk": Input(at(base + 4), samples.corrections()),
            "timecode": Input(at(base + 5), samples.timecode()),
            "station": Input(lambda data: far.sendto(data, back), frames),
        }
        log, judged = folder / "record" / "log", partial(verdict, config, [folder / "truth.jsonl"])
        one = {"service": client}, {"service": process}, {"service": log}
        yield Flight(*one, inputs, True, TRUE_ERRORS, judged)


def recorded(session: zenoh.Session, station: str, seconds: float) -> dict[str, list[bytes]]:
    """Messages of a station by topic, of some seconds."""
    found: dict[str, list[bytes]] = {}
    ring: zenoh.handlers.FifoChannel[zenoh.Sample] = zenoh.handlers.FifoChannel(4096)
    subscriber = session.declare_subscriber(f"{ROOT}/{station}/{BUNDLES}", ring)
    time.sleep(seconds)
    while (sample := subscriber.try_recv()) is not None:
        for topic, payload in parts_of(sample.payload.to_bytes()):
            found.setdefault(topic, []).append(payload)
    subscriber.undeclare()  # type: ignore[no-untyped-call]
    return found


@contextmanager
def a_site(folder: Path) -> Iterator[Flight]:
    """Two stations, and a stranger that speaks in the name of the second to the first."""
    with ExitStack() as stack:
        site = stack.enter_context(running_site(folder, 2, 2, shares_memory=False, scheduling="real-time"))
        site.start_show()
        endpoints = {station.name: station.endpoint for station in site.config.stations}
        config = configuration("south", endpoints, None)
        values = {"listen/endpoints": [], "connect/endpoints": [endpoints["north"].url(tls=False)]}
        for key, value in values.items():
            config.insert_json5(key, json.dumps(value))
        session = stack.enter_context(zenoh.open(config))
        time.sleep(1.0)
        received = recorded(session, "north", 5.0)
        makes = samples.bus({topic.replace(".south", ".north"): found for topic, found in received.items()})
        inputs = {"bus": Input(partial(session.put, f"{ROOT}/south/{BUNDLES}"), makes)}
        logs = {name: folder / f"{name}.log" for name in site.names}
        yield Flight(site.clients, site.processes, logs, inputs, False, OF_STRANGERS, site.verdict)


PARTS: Final = {"service": one_service, "site": a_site}


def send_for(chance: random.Random, flight: Flight, seconds: float, sent: Counter[str]) -> str:
    """Send a choice of samples. Returns: which, and how often."""
    chosen = []
    for name in chance.sample(list(flight.inputs), chance.randrange(1, len(flight.inputs) + 1)):
        one = flight.inputs[name]
        kinds = chance.sample(list(one.makes), chance.randrange(1, len(one.makes) + 1))
        made = {kind: [one.makes[kind](chance) for _ in range(MADE)] for kind in kinds}
        chosen.append((name, one, made, chance.choice(PER_S)))
    begin_s, due = time.monotonic(), Counter[str]()
    while (since_s := time.monotonic() - begin_s) < seconds:
        waits = True
        for name, one, made, per_s in chosen:
            if due[name] < since_s * per_s:
                waits = False
                due[name] += 1
                kind = chance.choice(list(made))
                one.send(chance.choice(made[kind]))
                sent[f"{name} {kind}"] += 1
        if waits:
            time.sleep(0.001)
    return "; ".join(f"{name} {per_s:g}/s: {', '.join(made)}" for name, _, made, per_s in chosen)


def problems(flight: Flight, read: dict[str, int]) -> Iterator[str]:
    """What is wrong after a round; `read`: bytes of each log that were looked at before."""
    for name, process in flight.processes.items():
        if process.poll() is not None:
            yield f"{name} ended with {process.poll()}"
            continue
        client = flight.clients[name]
        try:
            phase, fleet = client.show().phase, client.fleet().vehicles
        except GcsError as error:
            yield f"{name} does not answer: {error}"
            continue
        if flight.flies_on and phase != "running":
            yield f"{name}: the show is {phase}: {client.show().reason}"
        away = {one.id: one.phase for one in fleet if one.phase != "formation"}
        if flight.flies_on and away:
            yield f"{name}: {away}"
    for name, path in flight.logs.items():
        text = path.read_text(encoding="utf-8", errors="replace")
        more, read[name] = text[read.get(name, 0) :], len(text)
        for line in more.splitlines():
            is_error = any(f'"level": "{one}"' in line for one in ("error", "critical"))
            if "Traceback" in line or (is_error and not any(part in line for part in flight.true_errors)):
                yield f"{name} logged {line[:300]}"


def late_of(before: Mapping[str, Timing], after: Mapping[str, Timing]) -> tuple[int, float]:
    """Ticks, and how many of them were late or missed."""
    changes = [after[name].since(before[name]) for name in before]
    return sum(one.ticks for one in changes), sum(one.late + 20.0 * one.missed_s for one in changes)


def fuzz(flight: Flight, seen: Seen, chance: random.Random, seconds: float, machine: Pauses) -> None:
    end_s, read = time.monotonic() + seconds, dict[str, int]()
    list(problems(flight, read))
    while time.monotonic() < end_s:
        before = flight.timings()
        time.sleep(ROUND_S)
        quiet, quiet_late = late_of(before, before := flight.timings())
        began_s = time.monotonic()
        what = send_for(chance, flight, ROUND_S, seen.sent)
        ticks, late = late_of(before, flight.timings())
        paused_s = machine.stalled_s(began_s, time.monotonic())
        seen.rounds += 1
        seen.quiet_ticks, seen.quiet_late = seen.quiet_ticks + quiet, seen.quiet_late + quiet_late
        seen.ticks, seen.late, seen.paused_s = seen.ticks + ticks, seen.late + late, seen.paused_s + paused_s
        usual = max(quiet_late / max(quiet, 1), seen.quiet_late / seen.quiet_ticks)
        may_be = ticks * (LATE_SHARE + 2.0 * usual) + 20.0 * paused_s * len(flight.clients)
        wrong = list(problems(flight, read))
        if late > may_be:
            wrong.append(f"{late:.0f} of {ticks} ticks late, {may_be:.0f} at most")
        for one in wrong:
            seen.found.append(f"round {seen.rounds}: {one} ({what})")
            print(seen.found[-1], file=sys.stderr, flush=True)
        if any(process.poll() is not None for process in flight.processes.values()):
            return


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--part", choices=list(PARTS), action="append", help="one of them; else both")
    given: Any = parser.parse_args()
    parts = given.part or list(PARTS)
    seen, chance = Seen(given.seed, given.seconds), random.Random(given.seed)
    with tempfile.TemporaryDirectory(prefix="gcs-fuzz-") as folder, Pauses() as machine:
        for name in parts:
            place = Path(folder) / name
            place.mkdir()
            try:
                with PARTS[name](place) as flight:
                    fuzz(flight, seen, chance, given.seconds / len(parts), machine)
                if violations := flight.judged().violations:
                    seen.found.append(f"{name}: vehicles were too close {violations} times")
            except (AssertionError, GcsError) as error:  # it did not fly
                seen.found.append(f"{name}: {error}")
    print(json.dumps(vars(seen)))
    return 1 if seen.found else 0


if __name__ == "__main__":
    sys.exit(main())
