"""Programs that pages show run as they are printed."""

import re
import runpy
import sys
from pathlib import Path
from typing import Any

import pytest

from gcs import simulation
from gcs.simulation import DIMS, FlightResult, Scenario, fly

DOCS = Path(__file__).parents[2] / "docs"


def run(page: str) -> dict[str, Any]:
    """The names that the blocks of a page define, one after the other."""
    blocks = re.findall(r"^```python\n(.*?)^```$", (DOCS / page).read_text("utf-8"), re.DOTALL | re.MULTILINE)
    names: dict[str, Any] = {"__name__": "__main__"}
    for block in blocks:
        exec(compile(block, page, "exec"), names)  # noqa: S102
    return names


@pytest.mark.soak
def test_test_in_virtual_time_passes() -> None:
    tests = [each for name, each in run("how-to/test-in-virtual-time.md").items() if name.startswith("test_")]
    assert len(tests) == 1
    tests[0]()


@pytest.mark.soak
def test_page_about_simulation_runs() -> None:
    names = run("how-to/simulate-from-python.md")
    assert isinstance(names["flight"], FlightResult)
    assert set(names["arrays"]) == set(DIMS)
    assert names["state"].velocity_m_s[:, 0].mean() > 0.9, "the given velocities were flown"
    assert fly(names["built"], 3).radius_m[-1] == 12.0


def test_reference_lists_every_name_and_array() -> None:
    text = (DOCS / "reference/simulation.md").read_text("utf-8")
    listed = re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)
    assert listed == [*dict.fromkeys(listed)]
    assert set(listed) == {*simulation.__all__, *DIMS}
    types = dict(re.findall(r"^\| `(\w+)` \| [kn, 23]+ \| (\w+) \|", text, re.MULTILINE))
    arrays = fly(Scenario.load("assembly").with_(duration_s=0.5), 2).arrays()
    named = {name: array.dtype.name for name, array in arrays.items()} | {"vehicle": "str"}
    assert types == named


@pytest.mark.soak
def test_environment_is_stepped_as_gymnasium_does(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["formation_env"])
    names = runpy.run_path(str(DOCS / "examples/formation_env.py"), run_name="__main__")
    assert "off the sphere by 0.0 %" in capsys.readouterr().out
    env = names["FormationEnv"](vehicles=3, seconds=1.0)
    seen, _ = env.reset(seed=7)
    again, _ = env.reset(seed=7)
    assert (seen == again).all()
    assert seen.shape == env.observation_space.shape
    assert seen.dtype == env.observation_space.dtype
    truncated, steps = False, 0
    while not truncated:
        seen, reward, terminated, truncated, info = env.step(0.0 * seen[:, :3])
        steps += 1
        assert not terminated
        assert reward <= 0.0
    assert (steps, round(info["time_s"], 6)) == (19, 1.0)
