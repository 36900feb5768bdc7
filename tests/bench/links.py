"""What links and the service cost in percent of one core, beside what others cost and what must be reached.

`make bench` prints it; `python -m tests.bench.links service native 1000 20` measures one row, `... service`
or `... mavsdk` those rows only. The vehicles are `link_traffic`, in a process of their own; only the process
that flies them is measured.
"""

import contextlib
import logging
import os
import signal
import subprocess
import sys
from dataclasses import dataclass, replace

from gcs.cli.service.process import run_exactly
from tests.bench import link_bare, link_pymavlink, link_service, mavsdk_plainly
from tests.bench.link_measures import CannotError, Cost, flying

BROKEN_SHARE = 0.05
LONGEST_S = 90.0
"""Of a row; who is not through by then is ended."""

LAST_WORDS = 300
"""Characters that are shown of what somebody who failed said last."""


@dataclass(frozen=True, slots=True)
class Row:
    """What is measured: one line of the table."""

    what: str
    transport: str
    count: int
    rate_hz: float = 20.0  # of setpoints
    position_hz: float = 10.0  # of each vehicle's telemetry

    @property
    def title(self) -> str:
        """With the columns that say how many, how often."""
        columns = f"{self.count:>5}{self.rate_hz:>5.0f}{self.position_hz:>5.0f}"
        return f"{TITLES[self.what].format(self.transport):<34}{columns}"


TITLES = {
    "service": "the service over {}",
    "silent": "  with 5 % silent",
    "garbage": "  with 5 % that send garbage",
    "links": "  its links alone",
    "bare": "  bare sockets, in C",
    "plainly": "  MAVSDK, one instance",
    "wrapped": "  MAVSDK, its asyncio wrappers",
    "plainly-silent": "  MAVSDK, one instance, 5 % silent",
    "plainly-garbage": "  MAVSDK, one instance, 5 % garbage",
    "pymavlink": "  pymavlink per message",
    "connect": "connecting over {}",
    "connect-plainly": "  MAVSDK, one instance",
    "connect-pymavlink": "  pymavlink per message",
}

ROWS = (
    Row("service", "mavsdk", 64),
    Row("plainly", "mavsdk", 64),
    Row("wrapped", "mavsdk", 64),
    Row("service", "mavsdk", 250),
    Row("silent", "mavsdk", 250),
    Row("garbage", "mavsdk", 250),
    Row("plainly", "mavsdk", 250),
    Row("plainly-silent", "mavsdk", 250),
    Row("plainly-garbage", "mavsdk", 250),
    Row("wrapped", "mavsdk", 250),
    Row("service", "native", 1000),
    Row("links", "native", 1000),
    Row("pymavlink", "native", 1000),
    Row("service", "native", 2000, position_hz=5.0),
    Row("service", "native", 250, 50.0),
    Row("pymavlink", "native", 250, 50.0),
    Row("service", "native", 250),
    Row("silent", "native", 250),
    Row("garbage", "native", 250),
    Row("pymavlink", "native", 250),
    Row("connect", "mavsdk", 250),
    Row("connect", "native", 250),
    Row("connect-plainly", "mavsdk", 250),
    Row("connect-pymavlink", "native", 250),
)

OURS = frozenset({"service", "silent", "garbage", "connect"})
CORE_PERCENT = {
    Row("service", "mavsdk", 64): 15.0,
    Row("service", "mavsdk", 250): 40.0,
    Row("service", "native", 1000): 45.0,
    Row("service", "native", 2000, position_hz=5.0): 45.0,
    Row("service", "native", 250, 50.0): 25.0,
}
RESIDENT_MB = {
    Row("service", "native", 1000): 250.0,
    Row("service", "native", 2000, position_hz=5.0): 350.0,
}
"""Rows in which nothing may be lost, and no tick take long."""

TIMES_BARE = 4.0
"""The processor time of the service, over that of bare sockets with the same datagrams in the same run."""

BESIDE_BARE = Row("service", "native", 1000)
CONNECTED_S = 3.0
PASSED_ON_MS = 3.0
"""Beyond one tick period."""


@dataclass(frozen=True, slots=True)
class Requirement:
    """A figure that must be reached."""

    name: str
    figure: float
    most: float

    def __str__(self) -> str:
        """What, how much, and whether it is."""
        return f"{self.name} <= {self.most:g}: {'pass' if self.figure <= self.most else 'MISS'}"


def requirements(row: Row, cost: Cost) -> list[Requirement]:
    """What the service must reach in this row; of others nothing is asked."""
    if row.what not in OURS:
        return []
    required = [Requirement("passed on, ms", cost.passed_on_p99_ms, 1e3 / row.rate_hz + PASSED_ON_MS)]
    if row in CORE_PERCENT:
        required.insert(0, Requirement("% of a core", cost.core_percent, CORE_PERCENT[row]))
    lost = [
        Requirement("telemetry lost, %", cost.lost_in_percent, 0.0),
        Requirement("setpoints lost, %", cost.lost_out_percent, 0.0),
    ]
    if row in RESIDENT_MB:
        required += [
            Requirement("MB", cost.resident_mb, RESIDENT_MB[row]),
            *lost,
            Requirement("tick, ms", cost.tick_p99_ms, 25.0),
            Requirement("late, ms", cost.late_p99_ms, 10.0),
        ]
    if row.what in {"silent", "garbage"}:
        others = row.count - round(BROKEN_SHARE * row.count)
        fewer_percent = 100 * (1 - cost.per_s / (others * row.rate_hz))
        required += [*lost, Requirement("setpoints missing to the others, %", fewer_percent, 1.0)]
    return required


def measured(row: Row) -> Cost:
    """One row. Raises: CannotError."""
    count, rate_hz = row.count, row.rate_hz
    what, _, fault_injector = row.what.partition("-")
    fault_injector = fault_injector or (what if what in {"silent", "garbage"} else "")
    broken = round(BROKEN_SHARE * count) if fault_injector else 0
    options = ["--position-hz", str(row.position_hz)]
    if fault_injector:
        options += [f"--{fault_injector}", str(broken)]
    if what in {"plainly", "wrapped"}:
        options.append("--own-ports")
    with flying(count, *options) as fleet:
        if what == "plainly":
            return mavsdk_plainly.with_subscriptions(fleet, count, rate_hz, broken)
        if what == "wrapped":
            return run_exactly(mavsdk_plainly.with_wrappers(fleet, count, rate_hz))
        if what == "pymavlink":
            return link_pymavlink.per_message(fleet, count, rate_hz)
        if what == "bare":
            return link_bare.bare_sockets(fleet, count, rate_hz)
        config = link_service.config_of(count, rate_hz, row.transport, row.position_hz)
        if what == "links":
            return run_exactly(link_service.links_alone(fleet, config))
        return run_exactly(link_service.service(fleet, config, broken))


def connecting_s(row: Row) -> float:
    """The slowest of all. Raises: CannotError."""
    if row.what == "connect-plainly":
        return mavsdk_plainly.connecting_s(row.count)
    if row.what == "connect-pymavlink":
        return link_pymavlink.connecting_s(row.count)
    return run_exactly(link_service.connecting_s(row.count, row.transport))


def figures(cost: Cost) -> str:
    """The columns of `heads`; a dash for what was not measured."""
    formats = (
        (cost.core_percent, ">9.1f"),
        (cost.resident_mb, ">7.0f"),
        (cost.per_s, ">9.0f"),
        (cost.passed_on_p99_ms, ">12.1f"),
        (cost.tick_p99_ms, ">10.1f"),
        (cost.late_p99_ms, ">10.1f"),
        (cost.lost_in_percent, ">9.3f"),
        (cost.lost_out_percent, ">10.3f"),
    )
    return "".join(f"{figure:{how}}".replace("nan", "  -") for figure, how in formats)


def heads() -> str:
    """Over the columns."""
    columns = f"{'% core':>9}{'MB':>7}{'sent/s':>9}{'passed p99':>12}{'tick p99':>10}{'late p99':>10}"
    rates = f"{'N':>5}{'Hz':>5}{'in':>5}"
    return f"{'what (times in ms)':<34}{rates}{columns}{'lost in':>9}{'lost out':>10}"


def tell(row: Row) -> None:
    """Measure one row and print it, with what must be reached below."""
    try:
        if row.what.startswith("connect"):
            took_s = connecting_s(row)
            print(f"{row.title}{took_s:>9.2f} s, the slowest")
            required = [Requirement("s", took_s, CONNECTED_S)] if row.what in OURS else []
        else:
            cost = measured(row)
            print(f"{row.title}{figures(cost)}")
            required = requirements(row, cost)
    except CannotError as error:
        print(f"{row.title}   cannot: {error}")
        return
    if row == BESIDE_BARE:
        required += beside_bare(row, cost)
    if required:
        print(f"    must: {'; '.join(map(str, required))}")


def beside_bare(row: Row, cost: Cost) -> list[Requirement]:
    """Measure bare sockets in the same run and print their row; the service is compared with it."""
    bare = replace(row, what="bare")
    try:
        beside = measured(bare)
    except CannotError as error:
        print(f"{bare.title}   cannot: {error}")
        return []
    times = cost.core_percent / beside.core_percent
    print(f"{bare.title}{figures(beside)}   the service takes {times:.1f} times as much")
    return [Requirement("times bare sockets", times, TIMES_BARE)]


def describe(row: Row) -> str:
    """The same from a process of its own, whatever becomes of it."""
    command = [sys.executable, "-m", "tests.bench.links"]
    command += [row.what, row.transport, str(row.count), str(row.rate_hz), str(row.position_hz)]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        text, stated = process.communicate(timeout=LONGEST_S)
    except subprocess.TimeoutExpired:
        return f"{row.title}   not through after {LONGEST_S:.0f} s\n"
    finally:
        with contextlib.suppress(ProcessLookupError):  # its fleet, where it could not end that itself
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    if process.returncode != 0:
        return f"{row.title}   ended with code {process.returncode}: {stated.strip()[-LAST_WORDS:]}\n"
    return text


def main(desired: list[str]) -> int:
    """Print the table. Returns: 1 when a row of ours has no figures."""
    if len(desired) >= 3:
        logging.disable(logging.WARNING)  # a thousand vehicles found in the air say so
        print(heads())
        tell(Row(desired[0], desired[1], int(desired[2]), *map(float, desired[3:])))
        return 0
    print(heads())
    missed, failed = [], []
    for row in ROWS:
        if desired and desired[0] not in (row.what, row.transport):
            continue
        text = describe(row).removeprefix(heads() + "\n")
        print(text, end="", flush=True)
        if row.what in OURS and "must:" not in text:
            failed.append(row)
        if "MISS" in text:
            missed.append(row)
    for row in missed:
        print(f"not reached: {row.what} {row.transport} {row.count} {row.rate_hz:g} {row.position_hz:g}")
    for row in failed:
        print(f"not measured: {row.what} {row.transport} {row.count} {row.rate_hz:g} {row.position_hz:g}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
