"""Broken shows: each is refused with the line, the cue and what would be right."""

from pathlib import Path

import pytest

from gcs.model.errors import ConfigError, ShowError
from gcs.shows import find, load, parse, shipped
from tests.support.show_files import BROKEN, loaded, problems, text_of

FLOWN = {"battery-too-small", "orbit-never-reached", "tower-in-the-sphere"}
"""What only a flight shows: tests/flight/test_shows_checked.py."""

EXPECTED = {
    "cue-out-of-order": (21, "end", "at_s = 9: after the 10 s of 'change'"),
    "interrupted": (23, "end", "radius_m: 'change' is on its way until 25.0 s"),
    "into-the-ground": (19, "change", "height_m = 10.0: at least 11.0 m"),
    "key-twice": (21, None, "key 'height_m' is there twice"),
    "loop-to-nowhere": (24, None, "to_cue = finale: there is no such cue"),
    "not-a-colour": (19, "change", "lights.0 = 'red'"),
    "over-the-fence": (19, "change", "within 50.0 m of the origin"),
    "spin-too-fast": (19, "change", "at most 1 m/s^2: 20.2 deg/s"),
    "too-fast": (20, "change", "radius_m changes by 6 m, that takes at least 11.2 s"),
    "too-small": (19, "change", "radius_m = 3.5: at least 4.0 m for 8 vehicles"),
    "unknown-key": (19, "change", "diameter_m = 20"),
}


def test_every_broken_show_has_an_expected_problem() -> None:
    assert {path.stem for path in BROKEN.glob("*.yaml")} == FLOWN | set(EXPECTED)
    assert len(FLOWN | set(EXPECTED)) >= 12


@pytest.mark.parametrize("name", EXPECTED)
def test_broken_show_is_refused_with_line_cue_and_remedy(name: str) -> None:
    with pytest.raises(ShowError) as caught:
        load(BROKEN / f"{name}.yaml")
    line, cue, words = EXPECTED[name]
    (problem,) = caught.value.problems
    assert (problem.line, problem.cue) == (line, cue)
    assert words in problem.text
    assert f"{name}.yaml: line {line}:" in str(caught.value)


@pytest.mark.parametrize("name", sorted(FLOWN))
def test_problems_found_only_in_flight_pass_the_rules(name: str) -> None:
    assert load(BROKEN / f"{name}.yaml").show.fleet.vehicles == 8


def test_all_problems_are_reported_in_line_order() -> None:
    found = problems(
        {"cue": "a", "at_s": 5, "radius_m": 3}, {"cue": "b", "at_s": 25, "spin": {"rate_deg_s": 60}}
    )
    assert [problem.cue for problem in found] == ["a", "b"]
    assert found[0].line < found[1].line


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("about: [", 1, "not YAML"),
        ("about: x\n  y: z\n", 2, "not YAML"),
        ("a: &a [*b]\n", 1, "column 4: &a: anchors are not allowed"),
        ("[" * 5000, 1, "column 33: nested deeper than 32 levels"),
    ],
)
def test_what_is_not_yaml_is_refused_with_its_line(text: str, line: int, words: str) -> None:
    with pytest.raises(ShowError) as caught:
        parse(text, "trial.yaml")
    assert caught.value.problems[0].line == line
    assert words in str(caught.value)


def test_a_file_that_is_no_mapping_is_refused() -> None:
    with pytest.raises(ConfigError, match="a mapping is needed"):
        parse("- a\n- b\n", "trial.yaml")


def test_text_is_not_accepted_as_a_number() -> None:
    (found,) = problems(duration_s="60")
    assert "duration_s = '60'" in found.text


def test_a_show_cannot_lower_the_floor_nor_raise_a_limit() -> None:
    found = problems(limits={"separation_min_m": 1.0, "speed_max_m_s": 20.0})
    assert len(found) == 2


@pytest.mark.parametrize(
    ("cues", "changes", "words"),
    [
        (({"cue": "begin", "at_s": 5},), {}, "the name is there twice"),
        ((), {"duration_s": 1.0, "timeline": [{"cue": "a", "at_s": 2}]}, "the first cue begins at 0"),
        ((), {"timeline": [{"cue": "a", "at_s": 0}]}, "radius_m is missing"),
        (({"cue": "late", "at_s": 70},), {}, "longer than the 70 s of the last cue"),
        (({"cue": "a", "at_s": 55, "radius_m": 12},), {}, "the show ends at 60 s"),
        (({"cue": "a", "at_s": 5, "orbit": {"radius_m": 2, "speed_m_s": 3}},), {}, "orbit: radius_m = 2"),
        (({"cue": "a", "at_s": 5, "obstacles": {"go": ["x"]}},), {}, "no such obstacle stands"),
        (
            (),
            {"fleet": {"vehicles": 8, "pads": {"columns": 4, "spacing_m": 2}, "endurance_s": 9}},
            "spacing_m = 2",
        ),
    ],
)
def test_each_rule_names_what_is_wrong(
    cues: tuple[dict[str, object], ...], changes: dict[str, object], words: str
) -> None:
    assert any(words in problem.text for problem in problems(*cues, **changes))


def test_target_and_orbit_together_keep_the_formation_speed() -> None:
    orbit = {"radius_m": 20, "speed_m_s": 3.5}
    (found,) = problems(
        {"cue": "a", "at_s": 5, "orbit": orbit, "target": {"x_m": 20, "y_m": 0}, "over_s": 20}
    )
    assert "more than the formation's 4 m/s" in found.text


def test_path_with_too_hard_a_turn_is_refused() -> None:
    path = [{"after_s": 4, "x_m": 8, "y_m": 0}, {"after_s": 8, "x_m": 0, "y_m": 0}]
    (found,) = problems({"cue": "a", "at_s": 5, "target": {"path": path}})
    assert "m/s^2" in found.text


def test_path_begins_at_the_target() -> None:
    path = [{"after_s": 0, "x_m": 5, "y_m": 0}, {"after_s": 20, "x_m": 8, "y_m": 0}]
    (found,) = problems({"cue": "a", "at_s": 5, "target": {"path": path}})
    assert "the path begins 5.0 m from the target" in found.text


def test_loop_that_restarts_elsewhere_is_refused() -> None:
    path = [{"after_s": 0, "x_m": 0, "y_m": 0}, {"after_s": 8, "x_m": 5, "y_m": 0}]
    (found,) = problems(
        {"cue": "a", "at_s": 5, "target": {"path": path}},
        {"cue": "b", "at_s": 15},
        loops=[{"from_cue": "a", "to_cue": "b", "times": 2}],
    )
    assert "its loop repeats the cue of 5 s" in found.text


def test_nested_loops_are_refused() -> None:
    cues = [{"cue": name, "at_s": at_s} for name, at_s in (("a", 5), ("b", 10), ("c", 15))]
    loops = [
        {"from_cue": "a", "to_cue": "c", "times": 2},
        {"from_cue": "b", "to_cue": "c", "times": 2},
    ]
    (found,) = problems(*cues, loops=loops)
    assert "loops follow each other" in found.text


@pytest.mark.parametrize("path", shipped(), ids=lambda path: path.stem)
def test_every_shipped_show_is_valid_with_a_description(path: Path) -> None:
    show = load(path).show
    assert show.about.endswith(".")
    assert find(path.stem) == path


def test_five_shows_are_shipped() -> None:
    assert len(shipped()) >= 5


def test_missing_show_is_reported_with_the_existing_ones() -> None:
    with pytest.raises(ConfigError, match="breathing-sphere"):
        find("nothing")


def test_a_show_can_be_written_and_read_back() -> None:
    assert parse(text_of(), "x.yaml").show == loaded().show
