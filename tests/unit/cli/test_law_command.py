"""`gcs law`: a new law runs at once, conforms, and its name is valid everywhere once it is installed."""

import json
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from gcs.cli.law import class_name
from gcs.cli.main import main
from gcs.config import schema
from gcs.formation.laws import registry
from gcs.formation.laws.conformance import answered, problems, sample
from gcs.formation.laws.protocol import LawAnswer, LawInputs
from gcs.formation.laws.registry import SHIPPED, law_at, law_of
from gcs.formation.laws.settings import FlownLawSettings
from gcs.model.errors import ConfigError, InvalidError
from gcs.simulation import scenario as scenarios
from gcs.simulation.batch import broken
from gcs.simulation.flight import fly
from tests.support.hostile_laws import Hostile, HundredToOnePoint, Toggles


@pytest.fixture
def ring(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a new law, which is the current one."""
    monkeypatch.setattr(registry, "_beside", [])
    monkeypatch.chdir(tmp_path)
    assert main(["law", "new", "ring", "--json"]) == 0
    monkeypatch.chdir(tmp_path / "ring")
    monkeypatch.syspath_prepend(tmp_path / "ring")
    return tmp_path / "ring"


def install(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the package found as pip leaves it."""
    info = folder / "gcs_law_ring-0.1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: gcs-law-ring\nVersion: 0.1.0\n")
    (info / "entry_points.txt").write_text("[gcs.laws]\nring = ring_law:Ring\n")
    monkeypatch.setenv("PYTHONPATH", str(folder))
    registry.installed.cache_clear()


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_law_conforms(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["law", "check", name, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["good"]


def test_a_law_that_does_not_conform_is_named_with_a_reason() -> None:
    assert list(problems(Hostile())) == []
    assert any("it asks for 100 m/s" in problem for problem in problems(HundredToOnePoint()))
    assert not list(problems(Toggles())), "within all bounds of one answer; the flight sees it"


@pytest.mark.soak
@pytest.mark.long
def test_a_new_law_runs_at_once(
    ring: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["law", "check", "ring_law:Ring"]) == 0
    assert "conforms" in capsys.readouterr().out
    assert pytest.main(["-q", "-n", "0", "-p", "no:cacheprovider", "-c", "/dev/null", str(ring)]) == 0
    with pytest.raises(ConfigError, match="one of slots, article"):
        scenarios.load(ring / "ring.yaml")
    install(ring, monkeypatch)
    try:
        scenario = scenarios.load(ring / "ring.yaml")
        figures = fly(scenario, 8, 1).metrics.figures()
        assert "law_failed" not in figures
        assert broken(figures, scenario.judged.must) == []
        assert law_of("ring").goal_shape.value == "ring"
        law = FlownLawSettings(laws={"ring": {"turn": 2.0}})  # type: ignore[dict-item]
        control = scenario.control.model_copy(update={"law": law})
        with pytest.raises(ConfigError, match="law ring: its settings do not fit: turn: "):
            fly(scenario.model_copy(update={"control": control}), 8, 1)
        raw = schema.load(schema.find("demo")).model_dump()
        raw["formation"]["law"] = "ring"
        assert schema.Config.model_validate(raw).plan.formation.law == "ring"
    finally:
        monkeypatch.undo()
        registry.installed.cache_clear()


def test_code_beside_a_configuration_runs_only_when_allowed(
    ring: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (
        schema.find("demo")
        .read_text(encoding="utf-8")
        .replace("formation: {", "formation: {law: 'ring_law:Ring', ")
    )
    file = ring / "site.yaml"
    file.write_text(text, encoding="utf-8")
    assert main(["serve", "--config", str(file)]) == 2
    assert "code beside the configuration runs only with --allow-law-code" in capsys.readouterr().err
    registry.allow_code(ring)
    assert schema.load(file).formation.law == "ring_law:Ring"


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("slots", "a law of that name is shipped"),
        *((name, "it is no name of Python") for name in ("Ring", "a b", "../x", "1a", "a-b", "", "_")),
        *((name, "is a word of Python") for name in ("none", "true", "class", "import", "law_answer")),
    ],
)
def test_a_new_law_needs_a_name_of_its_own(
    name: str, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["law", "new", name]) == 2
    assert why in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["match_", "a__b", "print", "np", "inputs", "own"])
def test_whatever_name_is_accepted_is_valid_python(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path / name)
    assert main(["law", "new", name]) == 0
    for file in (tmp_path / name).glob("*.py"):
        compile(file.read_text(), file, "exec")
    law = law_at(f"{name}_law:{class_name(name)}")
    assert answered(law, sample(5, law.settings())).velocity_m_s.shape == (5, 3)


class NoAnswer(Hostile):
    """Returns what it is asked to return."""

    returned: object = None

    def velocity(self, inputs: LawInputs) -> LawAnswer:
        return cast("LawAnswer", self.returned)


@pytest.mark.parametrize(
    ("returned", "why"),
    [
        (None, "velocity() = None: a LawAnswer is needed: return LawAnswer(velocities)"),
        (np.zeros((1, 3)), "velocity() = ndarray: a LawAnswer is needed"),
        (LawAnswer([[0.0, 0.0, 0.0]]), "LawAnswer.velocity_m_s = list: a numpy array of floats"),  # type: ignore[arg-type]
        (LawAnswer(np.array([["a", "b", "c"]])), "LawAnswer.velocity_m_s = an array of <U1: a numpy"),
    ],
)
def test_what_is_no_answer_is_said_in_words(returned: object, why: str) -> None:
    law = NoAnswer()
    law.returned = returned
    (problem,) = problems(law)
    assert problem.startswith(why)


@pytest.mark.parametrize(
    ("attribute", "value", "why"),
    [
        ("settings", dict, "a class that inherits gcs.model.settings.Settings"),
        ("goal_shape", "cube", "one of sphere, ring, grid, helix, none"),
        ("stations", "each", "one of local, led"),
    ],
)
def test_what_a_law_says_of_itself_is_checked(
    attribute: str, value: object, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    law_at.cache_clear()
    monkeypatch.setattr(Hostile, attribute, value)
    with pytest.raises(InvalidError, match=f"{attribute} = .*: {why}"):
        law_at("tests.support.hostile_laws:Hostile")


@pytest.mark.soak
def test_a_limit_that_a_law_cannot_meet_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "assembly", "--law", "flocking"]) == 0
    shown = capsys.readouterr().out
    assert "assembly: not judged, because the law's goal_shape is none: formation.settled, " in shown
    assert main(["simulate", "assembly", "--law", "slots", "--json"]) == 0
    assert "not_judged" not in json.loads(capsys.readouterr().out.splitlines()[-1])
