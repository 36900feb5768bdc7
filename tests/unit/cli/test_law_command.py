"""`gcs law`: a new law runs at once, conforms, and its name is valid everywhere once it is installed."""

import json
from pathlib import Path

import pytest

from gcs.cli.main import main
from gcs.config import schema
from gcs.formation.laws import registry
from gcs.formation.laws.conformance import problems
from gcs.formation.laws.registry import SHIPPED, law_of
from gcs.formation.laws.settings import FlownLawSettings
from gcs.model.errors import ConfigError
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


@pytest.mark.parametrize("name", ["slots", "Ring", "a b", "../x"])
def test_a_new_law_needs_a_name_of_its_own(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["law", "new", name]) == 2
    assert "no name that is shipped" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_limit_that_a_law_cannot_meet_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "assembly", "--law", "flocking"]) == 0
    shown = capsys.readouterr().out
    assert "assembly: not judged, because the law's goal_shape is none: formation.settled, " in shown
    assert main(["simulate", "assembly", "--law", "slots", "--json"]) == 0
    assert "not_judged" not in json.loads(capsys.readouterr().out.splitlines()[-1])
