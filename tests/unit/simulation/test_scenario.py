"""Scenario files: what is shipped can be flown, what is wrong is refused with what would be right."""

from pathlib import Path

import pytest

from gcs.model.errors import ConfigError
from gcs.simulation import scenario as scenarios
from gcs.simulation.scenario import FormationFlight, GoalFlight, Scenario

PLAIN = """
about: a trial
duration_s: 10
flight: {kind: formation}
judged: {vehicles: [4]}
"""


def written(folder: Path, text: str, name: str = "trial") -> Path:
    path = folder / f"{name}.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def refusal(folder: Path, text: str) -> str:
    with pytest.raises(ConfigError) as caught:
        scenarios.load(written(folder, text))
    return str(caught.value)


@pytest.mark.parametrize("path", scenarios.shipped(), ids=lambda path: path.stem)
def test_every_shipped_scenario_is_valid_with_a_description(path: Path) -> None:
    scenario = scenarios.load(path)
    assert scenario.name == path.stem
    assert scenario.about.endswith(".")
    assert scenario.row is not None


@pytest.mark.parametrize("path", scenarios.shipped(), ids=lambda path: path.stem)
def test_no_shipped_scenario_lowers_the_floor(path: Path) -> None:
    floor = scenarios.load(path).control.safety.floor
    assert floor.horizontal_m >= 2.0
    assert floor.vertical_m >= 3.0


def test_a_scenario_is_named_after_its_file(tmp_path: Path) -> None:
    assert scenarios.load(written(tmp_path, PLAIN, "mine")).name == "mine"


def test_scenario_inherits_what_it_does_not_set(tmp_path: Path) -> None:
    written(tmp_path, PLAIN + "world: {noise: 1.0, loss: 0.1}\n", "base")
    like = scenarios.load(written(tmp_path, "like: base\nabout: another\nworld: {loss: 0.2}\n"))
    assert like.about == "another"
    assert like.duration_s == 10.0
    assert (like.world.noise, like.world.loss) == (1.0, 0.2)


def test_worlds_take_turns_over_seeds_and_keep_what_world_sets(tmp_path: Path) -> None:
    worlds = "worlds: [{drag_per_s: 0.2}, {vehicle: cascade, bias_m: 0.3}]\n"
    scenario = scenarios.load(written(tmp_path, PLAIN + "world: {noise: 1.0}\n" + worlds))
    even, odd = (scenario.in_world_of(seed).world for seed in (6, 7))
    assert (even.vehicle, even.drag_per_s, even.noise) == ("fitted", 0.2, 1.0)
    assert (odd.vehicle, odd.drag_per_s, odd.bias_m) == ("cascade", 1.0, 0.3)


def test_a_wrong_setting_of_one_world_is_refused_by_name(tmp_path: Path) -> None:
    assert "worlds" in refusal(tmp_path, PLAIN + "worlds: [{drag_per_s: -1}]\n")


def test_empty_value_removes_an_inherited_one(tmp_path: Path) -> None:
    gated = PLAIN.replace("vehicles: [4]", "vehicles: [4], must: {separation.violations: {most: 0}}")
    written(tmp_path, gated, "base")
    like = scenarios.load(written(tmp_path, "like: base\njudged: {must: {separation.violations: }}\n"))
    assert like.judged.must == {}


def test_a_shipped_scenario_is_found_by_name_and_by_path() -> None:
    assert scenarios.find("assembly").samefile(scenarios.find("configs/scenarios/assembly.yaml"))
    assert isinstance(scenarios.load(scenarios.find("assembly")).flight, FormationFlight)
    assert isinstance(scenarios.load(scenarios.find("swap-212")).flight, GoalFlight)


def test_an_unknown_name_is_refused_with_those_there_are() -> None:
    with pytest.raises(ConfigError, match="assembly"):
        scenarios.find("asembly")


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("[1, 2]", "a mapping is needed"),
        ("about: x", "duration_s"),
        (PLAIN + "duration_s: 3", "twice"),
        (PLAIN.replace("formation", "procession"), "formation"),
        (PLAIN + "world: {loss: 1.5}", "world.loss"),
        (PLAIN + "world: {lost: 0.1}", "world.lost"),
        (PLAIN.replace("duration_s: 10", "duration_s: -1"), "duration_s"),
        (PLAIN.replace("[4]", "[0]"), "judged.vehicles"),
        (PLAIN.replace("{kind: formation}", "{kind: formation, change_s: 10}"), "before duration_s"),
        (PLAIN.replace("{kind: formation}", "{kind: goals, layout: cube}"), "extent_m"),
        (PLAIN + "control: {law: {speed_m_s: .nan}}", "speed_m_s"),
        ("like: 3", "name of another scenario"),
        ("like: unknown", "unknown"),
        ("like: trial", "no longer chain"),
        ("about: \x00", "YAML"),
    ],
)
def test_impossible_scenario_is_refused(tmp_path: Path, text: str, reported: str) -> None:
    message = refusal(tmp_path, text)
    assert reported in message
    assert "trial.yaml" in message or reported == "unknown"


def test_a_file_that_is_not_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "trial.yaml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="cannot be read"):
        scenarios.load(path)


def test_scenarios_are_immutable() -> None:
    scenario = scenarios.load(scenarios.find("assembly"))
    with pytest.raises(ValueError, match="frozen"):
        scenario.duration_s = 1.0
    assert isinstance(scenario, Scenario)
