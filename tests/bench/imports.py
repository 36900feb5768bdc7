"""Every drawing of `tests.support.imports_flown`: imported, checked, and flown by `gcs simulate`.

`python -m tests.bench.imports [KIND ...]` prints a line of JSON for each, and the table of the documentation.
Two are flown at a time: it takes a quarter of an hour.
"""

import json
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from multiprocessing import get_context
from statistics import median

from tests.support.imports_flown import Outcome, flown, made

TITLES = "kind | drawings | refused | flown | track | farthest | closest | viol. | missing | apart | colours"


def table(outcomes: Sequence[Outcome]) -> str:
    """One row for each kind; `track` is median / worst, of all others the worst or the sum."""
    rows = [TITLES, " | ".join(["---"] * len(TITLES.split("|")))]
    for kind in dict.fromkeys(each.kind for each in outcomes):
        ours = [each for each in outcomes if each.kind == kind]
        ends = [each for each in ours if not each.refused]
        cells = [kind, str(len(ours)), str(len(ours) - len(ends)), str(len(ends))]
        if ends:
            rms_m = [each.rms_m for each in ends]
            cells += [
                f"{median(rms_m):.3f}/{max(rms_m):.3f}",
                f"{max(each.max_m for each in ends):.2f}",
                f"{min(each.closest_m for each in ends):.2f}".replace("inf", ""),
                str(sum(each.violations for each in ends)),
                str(sum(each.missing for each in ends)),
            ]
        cells += [""] * (9 - len(cells))
        read = [each for each in ours if each.vehicles]
        for worst, form in (("apart_m", ".4f"), ("colours", ".2f")):
            cells.append(format(max(getattr(each, worst) for each in read), form) if read else "")
        rows.append(" | ".join(cells))
    return "\n".join(f"| {row} |" for row in rows)


def main(kinds: Sequence[str]) -> None:
    """Fly all drawings, or those of some kinds."""
    outcomes = []
    drawings = [drawing for drawing in made() if not kinds or drawing.kind in kinds]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for outcome in pool.map(flown, drawings):
            outcomes.append(outcome)
            print(json.dumps(asdict(outcome)), flush=True)
    print(table(outcomes))


if __name__ == "__main__":
    main(sys.argv[1:])
