"""A law of another package is not trusted: whatever it does, all vehicles hold, and the filter is on."""

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs.flight.features.laws.process import BEGINS_S, BUDGET_SHARE, LawProcess
from gcs.formation.laws import registry
from gcs.formation.laws.conformance import sample
from gcs.formation.laws.protocol import NoSettings
from gcs.model.state import Array
from gcs.simulation import Scenario
from gcs.simulation import fly as simulate
from tests.support.hostile_laws import REASONS, WELL_TICKS

pytestmark = pytest.mark.long

SUPPORT = Path(__file__).parents[1] / "support"
COUNT, TICK_S, HOLDS_WITHIN_S, STANDS_M_S = 20, 0.05, 0.5, 0.4
FLIGHTS_MOST = 10
HOSTILE_S = WELL_TICKS * TICK_S


@pytest.fixture(autouse=True)
def _beside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_beside", [])
    registry.allow_code(SUPPORT)


def assembly(law: str, duration_s: float) -> Scenario:
    return Scenario.load("assembly").with_(law=f"hostile_laws:{law}", duration_s=duration_s)


@pytest.mark.keeps("NotANumber", "NeverReturns", "EndsItsProcess")
@pytest.mark.parametrize("law", REASONS)
def test_all_hold_whatever_a_law_does(law: str) -> None:
    flight = simulate(assembly(law, 6.0), COUNT, 3)
    failed = flight.metrics.law_failed
    assert failed is not None
    assert failed.why.startswith(REASONS[law])
    assert HOSTILE_S - TICK_S <= failed.time_s <= HOSTILE_S + HOLDS_WITHIN_S
    speed_m_s = np.linalg.norm(flight.velocity_m_s, axis=2).max(axis=1)
    assert speed_m_s[round((failed.time_s + 1.5) / TICK_S) :].max() < STANDS_M_S
    assert flight.metrics.separation.violations == 0


@pytest.mark.soak
def test_a_law_that_sleeps_delays_no_tick() -> None:
    """In true time: the tick waits for 10 ms at most, and for no answer after a quarter of a second.

    Whatever else the machine does makes a tick longer, never shorter, and never the same one each time: of
    each tick the quickest of several flights counts.
    """
    quickest_s = np.full(WELL_TICKS + 6, np.inf)
    for _ in range(FLIGHTS_MOST):
        quickest_s = np.minimum(quickest_s, ticks_with_a_law_that_sleeps_s())
        if quickest_s.max() < 2.0 * BUDGET_SHARE * TICK_S:
            break
    assert quickest_s.max() < 2.0 * BUDGET_SHARE * TICK_S
    waits_s = quickest_s[WELL_TICKS : WELL_TICKS + 5]
    assert waits_s.min() > 0.5 * BUDGET_SHARE * TICK_S, "these ticks wait for an answer"


def ticks_with_a_law_that_sleeps_s() -> Array:
    """How long each tick of a flight takes in which the law sleeps after `WELL_TICKS`.

    inf: the machine kept the law's process from running so long that it failed before.
    """
    law = LawProcess("hostile_laws:SleepsASecond", {}, COUNT, TICK_S)
    law.begin(BEGINS_S)
    inputs, took_s, held = sample(COUNT, NoSettings()), [], []
    for _ in range(WELL_TICKS + 6):
        began_s = time.monotonic()
        answer = law.velocity(inputs)
        took_s.append(time.monotonic() - began_s)
        held.append(answer.holds)
    law.close()
    assert answer.holds
    assert law.failed.startswith(REASONS["SleepsASecond"])
    return np.where(any(held[: WELL_TICKS + 4]), np.inf, took_s)


@pytest.mark.soak
@pytest.mark.parametrize(("pause_s", "fails"), [(0.5, True), (2.0, False)])
def test_a_law_that_was_not_asked_for_a_second_begins_anew(pause_s: float, fails: bool) -> None:
    """Its state is the number of its ticks: it fails when they are more than `WELL_TICKS`."""
    law = LawProcess("hostile_laws:Fails", {}, COUNT, TICK_S, 1.0)
    law.begin(BEGINS_S)
    inputs, well = sample(COUNT, NoSettings()), WELL_TICKS - 5
    for tick in range(2 * well):
        time_s = tick * TICK_S + (pause_s if tick >= well else 0.0)
        law.velocity(replace(inputs, time_s=time_s))
    law.close()
    assert bool(law.failed) is fails


def statuses() -> Iterator[tuple[int, str, int, int]]:
    """Number, state, parent and process group of each process."""
    for status in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            state, parent, group = status.read_text().rpartition(") ")[2].split()[:3]
            yield int(status.parent.name), state, int(parent), int(group)


def group_of(law: str, service: int) -> int:
    """The process group of the law that a service began."""
    for number, _, parent, group in statuses():
        if parent == service and f":{law}\0" in Path(f"/proc/{number}/cmdline").read_text():
            return group
    raise AssertionError(law)


def ends(group: int) -> bool:
    """Whether no process of the group runs within 10 s; one that has ended and is not waited for does not."""
    until_s = time.monotonic() + 10.0
    while runs := any(its == group and state not in "ZX" for _, state, _, its in statuses()):
        if time.monotonic() > until_s:
            break
        time.sleep(0.05)
    return not runs


@pytest.mark.soak
def test_no_child_of_a_law_is_left() -> None:
    law = LawProcess("hostile_laws:Forks", {}, COUNT, TICK_S)
    law.begin(BEGINS_S)
    group = group_of("Forks", os.getpid())
    for _ in range(WELL_TICKS + 20):
        law.velocity(sample(COUNT, NoSettings()))
    assert law.failed
    assert ends(group)
    law.close()


SERVICE = f"""
import time
from pathlib import Path
from gcs.flight.features.laws.process import BEGINS_S, LawProcess
from gcs.formation.laws import registry
from gcs.formation.laws.conformance import sample
from gcs.formation.laws.protocol import NoSettings
registry.allow_code(Path({str(SUPPORT)!r}))
law = LawProcess("hostile_laws:TakesNoSignal", {{}}, {COUNT}, {TICK_S}, 1.0)
law.begin(BEGINS_S)
for _ in range({WELL_TICKS + 1}):
    law.velocity(sample({COUNT}, NoSettings()))
print(law.failed or "asked", flush=True)
time.sleep(600.0)
"""


def test_a_law_ends_with_a_killed_service() -> None:
    """In a call that never returns, and with each signal refused that can be."""
    with subprocess.Popen([sys.executable, "-c", SERVICE], stdout=subprocess.PIPE, text=True) as service:
        assert service.stdout is not None
        try:
            assert service.stdout.readline() == "asked\n"
            group = group_of("TakesNoSignal", service.pid)
        finally:
            service.kill()
    assert ends(group)


def test_a_law_that_leads_all_to_one_point_meets_the_filter() -> None:
    flight = simulate(assembly("ToOnePoint", 15.0), COUNT, 3)
    assert flight.metrics.law_failed is None
    assert flight.metrics.separation.violations == 0
