"""What `gcs law new NAME` writes: a package with one law, a ring that turns."""

from typing import Final

FILES: Final = {
    "pyproject.toml": """\
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "gcs-law-NAME"
version = "0.1.0"
description = "A law for formation-gcs"
requires-python = ">=3.11"
dependencies = ["formation-gcs"]

[project.entry-points."gcs.laws"]
NAME = "MODULE:CLASS"

[tool.hatch.build]
only-include = ["MODULE.py"]
""",
    "MODULE.py": '''\
"""The law `NAME`: a level ring that turns."""

import numpy as np

from gcs.formation.article import no_faster
from gcs.formation.laws.protocol import FormationLaw, GoalShape, LawAnswer, LawInputs
from gcs.model.settings import Positive, Settings


class CLASSSettings(Settings):
    """In a configuration: `control: {law: {laws: {NAME: {turn_m_s: 2.0}}}}`."""

    rate_per_s: Positive = 0.5
    """Rate at which a vehicle comes onto the ring, and to the middle between its neighbours, in 1/s."""
    turn_m_s: float = 1.0
    """Speed along the ring, clockwise from above, in m/s."""


class CLASS(FormationLaw):
    """Vehicles spread evenly over a ring round the centre, as wide as they need to be."""

    settings = CLASSSettings
    goal_shape = GoalShape.RING
    turns_alike = True

    def velocity(self, inputs: LawInputs) -> LawAnswer:
        own = CLASSSettings.model_validate(inputs.settings)
        radius_m = max(inputs.radius_m, 1.2 * len(inputs.ids) * inputs.apart_m / (2.0 * np.pi))
        offset_m = inputs.position_m - inputs.center_m
        angle_rad = np.arctan2(offset_m[:, 1], offset_m[:, 0])
        order = np.argsort(angle_rad)
        gap_rad = np.diff(angle_rad[order], append=angle_rad[order[0]] + 2.0 * np.pi)
        ahead_rad = np.empty_like(gap_rad)
        ahead_rad[order] = gap_rad - np.roll(gap_rad, 1)  # more room ahead than behind
        outward = np.column_stack([np.cos(angle_rad), np.sin(angle_rad), np.zeros_like(angle_rad)])
        along = np.column_stack([-outward[:, 1], outward[:, 0], outward[:, 2]])
        off_m = radius_m * outward - offset_m
        spread_m_s = own.rate_per_s * radius_m * ahead_rad[:, None] / 4.0
        asked_m_s = inputs.rate_share * (own.rate_per_s * off_m + spread_m_s * along) + own.turn_m_s * along
        return LawAnswer(no_faster(asked_m_s, inputs.own_speed_max_m_s))
''',
    "test_NAME.py": '''\
"""The law `NAME` conforms, and its vehicles end on a ring that turns."""

import numpy as np

from gcs.formation.laws.conformance import flown, problems, sample
from MODULE import CLASS, CLASSSettings


def test_it_conforms() -> None:
    assert list(problems(CLASS())) == []


def test_vehicles_end_evenly_on_a_ring_that_turns() -> None:
    *_, (inputs, answer) = flown(CLASS(), sample(8, CLASSSettings()), 1200)
    offset_m = inputs.position_m - inputs.center_m
    assert np.allclose(np.hypot(offset_m[:, 0], offset_m[:, 1]), inputs.radius_m, atol=0.1)
    assert np.allclose(offset_m[:, 2], 0.0, atol=0.1)
    assert np.allclose(np.linalg.norm(answer.velocity_m_s, axis=1), 1.0, atol=0.05)
''',
    "NAME.yaml": """\
about: Eight vehicles from a ground grid onto the ring of the law NAME.
row: laws
duration_s: 60
flight: {kind: formation, law: NAME, radius_m: 12}
world: {drag_per_s: 0.2}
judged:
  vehicles: [8]
  seeds: 3
  must:
    separation.violations: {most: 0}
    formation.radius_share: {most: 0.02}
""",
    "README.md": """\
# The law NAME

A law for formation-gcs: `MODULE.py` has it, in about thirty lines.

    pip install -e .                              # from now on `law: NAME` is valid everywhere
    gcs law check NAME                            # shapes, finite numbers, the same answer twice, time
    pytest                                        # test_NAME.py
    gcs simulate NAME.yaml --judged               # flown in virtual time, and judged
    gcs simulate assembly --law NAME --vehicles 30 --plot NAME.png
    gcs demo --law NAME

In a configuration: `formation: {law: NAME, ...}`. The station runs it in a process of its own, and holds all
vehicles when it is late, fails, or asks for what it may not.
""",
}
"""Contents by name of the file; NAME, MODULE and CLASS stand for those of the law."""
