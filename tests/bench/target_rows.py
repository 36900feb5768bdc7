"""Targets with a source that fails, flown over seeds: `python -m tests.bench.target_rows ROW`."""

import sys
from collections.abc import Sequence
from statistics import median
from typing import Final

from tests.support.target_flights import FAULTS, MOVING, drop_outs, failed, switched

SEEDS: Final = 2
LATER_S: Final = (0.0, 3.0, 6.0, 9.0, 12.0)
"""Drop-outs begin at these moments of a motion."""


def _drop_outs(names: Sequence[str]) -> None:
    print(
        "| motion | back after 1, 3, 10 s: median, s | worst, s | exact: median, s | worst, s | no sooner, s "
        "| step | violations |\n|---|---|---|---|---|---|---|---|"
    )
    for name in names:
        begun = [(seed, later_s) for later_s in LATER_S for seed in range(SEEDS)]
        flown = [drop_outs(name, *begins) for begins in begun]
        exact = [drop_outs(name, *begins, exact=True) for begins in begun]
        back_s = [[each.back_s[length] for each in of] for of in (flown, exact) for length in range(3)]
        middle, worst = ([f"{pick(each):.1f}" for each in back_s] for pick in (median, max))
        times_s = (middle[:3], worst[:3], middle[3:], worst[3:])
        least = [f"{median(each.least_s[at] for each in flown):.1f}" for at in range(3)]
        step, violations = max(each.step for each in flown), sum(each.violations for each in flown)
        cells = [name, *(", ".join(each) for each in (*times_s, least)), f"{step:.2f}", str(violations)]
        print(f"| {' | '.join(cells)} |", flush=True)


def _faults(names: Sequence[str]) -> None:
    print("| motion | fails | from honest, m | from silent, m | noticed, s | said | violations |")
    print("|---|---|---|---|---|---|---|")
    for name in names:
        flown = [failed(name, tuple(FAULTS), seed) for seed in range(SEEDS)]
        for fault in FAULTS:
            of = [each[fault] for each in flown]
            honest_m, silent_m = max(each.off_honest_m for each in of), max(each.off_silent_m for each in of)
            noticed, violations = max(each.noticed_s for each in of), sum(each.violations for each in of)
            figures = f"{honest_m:.1f} | {silent_m:.1f} | {noticed:.1f} | {of[0].why} | {violations}"
            print(f"| {name} | {fault} | {figures} |", flush=True)


def _switches(names: Sequence[str]) -> None:
    print("| motion | changes | over, s | jump, m | violations |\n|---|---|---|---|---|")
    for name in names:
        flown = [switched(name, seed) for seed in range(SEEDS)]
        over_s, jump_m = max(each.over_s for each in flown), max(each.jump_m for each in flown)
        changes, violations = min(each.changes for each in flown), sum(each.violations for each in flown)
        print(f"| {name} | {changes} | {over_s:.2f} | {jump_m:.2f} | {violations} |", flush=True)


ROWS: Final = {"drop-outs": _drop_outs, "faults": _faults, "switches": _switches}

if __name__ == "__main__":
    ROWS[sys.argv[1]](sys.argv[2:] or tuple(MOVING))
