"""Vehicles that report what is not so: they are named, fly little on it, and the others keep apart."""

from functools import partial
from math import ceil
from typing import Any, Final, NamedTuple

import numpy as np
import pytest

from gcs.config.schema import Config
from gcs.model.lifecycle import Phase
from gcs.model.state import Array
from gcs.planning.feasibility import smallest_formation_radius_m
from gcs.safety.floor import minimum_separation
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, VirtualShow, fly, show_config
from tests.support.show_phases import running

SECONDS: Final = 30.0
NAMED_S, ON_A_LIE_M = 2.0, 5.0
STANDS, STRAYS = "its position stands still", "its position goes elsewhere than its velocity"
LATE, LATE_S = "its positions arrive late", {"late": 1.5, "answers-late": 1.0}
"""And by so much: before that nothing arrives that could be a lie."""

LIES: Final[dict[str, tuple[tuple[str, dict[str, Any]], ...]]] = {
    "repeats": (("report-freeze", {}),),
    "receiver-stands": (("gps-freeze", {}),),
    "wrong-sign": (("report-velocity", {"times": -1.0}),),
    "late": (("delay", {"delay_s": LATE_S["late"]}),),
    "answers-late": (("delay", {"delay_s": LATE_S["answers-late"], "way": "out"}),),
}
SAYS: Final = {"repeats": STANDS, "receiver-stands": STANDS, "wrong-sign": STRAYS} | dict.fromkeys(
    LATE_S, LATE
)


class Reported(NamedTuple):
    """What was seen."""

    named_s: dict[str, float]  # of each liar, after it began
    texts: set[str]
    flown_m: float  # farthest that a liar was led, while it was
    violations: int  # ticks, of pairs that report truly
    all_violations: int  # of all pairs
    others: set[tuple[Phase, ...]]  # phases of those that report truly


def config(count: int) -> Config:
    """In the smallest formation that is accepted, while its centre flies on."""
    wide_m = 1.02 * smallest_formation_radius_m(count, show_config(2).control.safety, np.full(count, 0.25))
    return show_config(
        count,
        formation={"radius_m": max(6.0, round(wide_m, 1)), "height_m": max(6.0, wide_m) + 9.0},
        orbit={"radius_m": 12.0, "speed_m_s": 2.0},
        operation={**HOLDS_WHEN_LOST, "takeoff_stagger_s": 0.2, "pads_within_m": 70.0},
    )


def _violations(show: VirtualShow, true_m: Array, rows: list[int]) -> int:
    floor, all_of_them = show.config.control.safety.floor, np.ones(len(rows), np.bool_)
    return sum(minimum_separation(here_m[rows], all_of_them, floor)[1] > 0 for here_m in true_m)


async def lied(show: VirtualShow, kind: str, share: float, seed: int) -> Reported:
    """Let this share of the vehicles, drawn by the seed, report so from now on."""
    random, ids, began_s = np.random.default_rng(seed), show.config.ids, show.now_s
    liars = random.choice(len(ids), max(1, round(share * len(ids))), replace=False).tolist()
    named_s, texts = dict[str, float](), set[str]()
    for turn in range(round(SECONDS / 0.1)):
        if turn == 0 or (kind == "jumps" and turn in {50, 100, 150, 200}):
            for row in liars:
                befall(show, ids[row], kind, random)
        await show.wait(0.1)
        for alarm in show.view.alarms:
            texts.add(alarm.text)
            for name in set(alarm.vehicles) & {ids[row] for row in liars}:
                named_s.setdefault(name, show.now_s - began_s)
    track = show.track.between(began_s)
    flown_m = [
        sum(
            float(np.linalg.norm(now.true_m[row] - before.true_m[row]))
            for before, now, seen in zip(track.samples, track.samples[1:], track.of(ids[row]), strict=False)
            if seen.phase is Phase.FORMATION and seen.setpoint_m_s is not None
        )
        for row in liars
    ]
    true = [row for row in range(len(ids)) if row not in liars]
    return Reported(
        named_s,
        texts,
        max(flown_m),
        _violations(show, track.true_m, true),
        _violations(show, track.true_m, list(range(len(ids)))),
        {tuple(track.phases(ids[row])) for row in true},
    )


def befall(show: VirtualShow, name: str, kind: str, random: np.random.Generator) -> None:
    """Begin to lie, or jump (again)."""
    for fault, values in LIES.get(kind, ()):
        show.befall(name, fault, **values)
    if kind in {"jump", "jumps"}:
        way_m = random.normal(size=3)
        way_m *= (4.0 if kind == "jump" else 3.0) / np.linalg.norm(way_m)
        shift = dict(zip(("north_m", "east_m", "down_m"), way_m.tolist(), strict=True))
        show.befall(name, "gps-jump", **shift)


def flown(kind: str, count: int, share: float, seed: int) -> Reported:
    wide = {"noise_scale": 1.0, "grid_columns": ceil(count**0.5), "spacing_m": 6.0, "seed": 1}
    story = partial(lied, kind=kind, share=share, seed=seed)
    return fly(story, config(count), after=running, **wide)


SHORT: Final = ("repeats", "jump")
"""Kinds of lies of `make test`."""


def soaked(kind: str) -> list[object]:
    """The one of `make test`, if any, and those of `make soak`."""
    sizes = [(8, 0.13), (8, 0.2), (20, 0.2), (50, 0.02), (50, 0.2)]
    cases = [(kind, count, share, seed) for count, share in sizes for seed in range(5)]
    return [
        pytest.param(*case, marks=pytest.mark.soak if at or kind not in SHORT else ())
        for at, case in enumerate(cases)
    ]


@pytest.mark.parametrize(("kind", "count", "share", "seed"), [case for kind in LIES for case in soaked(kind)])
def test_liar_is_named_and_not_led_on(kind: str, count: int, share: float, seed: int) -> None:
    seen = flown(kind, count, share, seed)
    assert len(seen.named_s) == max(1, round(share * count))
    assert max(seen.named_s.values()) <= NAMED_S + LATE_S.get(kind, 0.0)
    assert any("without a trusted position" in text and SAYS[kind] in text for text in seen.texts), seen.texts
    assert seen.flown_m <= ON_A_LIE_M
    assert seen.violations == 0
    if share * count < 2:
        assert seen.all_violations == 0, "its way down, which no report shows, is kept clear"
    assert seen.others == {(Phase.FORMATION,)}


@pytest.mark.soak
@pytest.mark.parametrize(
    ("kind", "count", "share", "seed"), [case for kind in ("jump", "jumps") for case in soaked(kind)]
)
def test_others_keep_clear_of_both_places(kind: str, count: int, share: float, seed: int) -> None:
    seen = flown(kind, count, share, seed)
    assert len(seen.named_s) == max(1, round(share * count))
    assert max(seen.named_s.values()) <= NAMED_S
    assert any("uncertain of" in text and "jumped by" in text for text in seen.texts), seen.texts
    assert seen.violations == 0
    if share * count < 2:  # two that jump at once each say where the other is not
        assert seen.all_violations == 0
    assert seen.others == {(Phase.FORMATION,)}
