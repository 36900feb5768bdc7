"""Drawings of other programs are imported, checked, exported and flown, or refused for a physical reason."""

import pytest

from tests.support.imports_flown import GENERATORS, LENGTHS, PHYSICAL, Drawing, Outcome, flown, made

pytestmark = pytest.mark.soak

CHOSEN = {
    "blender.skyc": "",
    "cf3.csv": "never 3 m or higher",
    "show5.skyc": "closer than the floor",
    "show7.zip": "",
}
"""Files, and why they are refused; of files that are called alike the first."""

KINDS = {"generators": len(GENERATORS), "csv indoors": len(LENGTHS), "csv": len(LENGTHS), "generated": 200}


def judge(outcome: Outcome) -> None:
    """Fail for a drawing that was neither flown as it should be, nor refused with time and vehicles."""
    if outcome.refused:
        assert PHYSICAL.search(outcome.refused), outcome
        return
    assert outcome.apart_m <= 0.01, outcome
    assert outcome.colours <= 1.0, outcome
    assert (outcome.violations, outcome.missing) == (0, 0), outcome
    assert outcome.rms_m <= 0.3, outcome


@pytest.mark.keeps("blender.skyc", "cf3.csv", "show5.skyc")
@pytest.mark.parametrize("name", CHOSEN)
def test_an_import_is_flown_or_refused(name: str) -> None:
    outcome = flown(next(drawing for drawing in made() if drawing.name == name))
    assert CHOSEN[name] in outcome.refused
    assert bool(CHOSEN[name]) == bool(outcome.refused)
    judge(outcome)


@pytest.mark.soak
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("kind", KINDS)
def test_every_import_is_flown_or_refused(kind: str) -> None:
    drawings: list[Drawing] = [drawing for drawing in made() if drawing.kind == kind]
    assert len(drawings) == KINDS[kind]
    for drawing in drawings:
        judge(flown(drawing))
