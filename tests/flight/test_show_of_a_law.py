"""A written show that names a law of another package: checked, and flown, with the settings that it gives."""

import json
from pathlib import Path

import numpy as np
import pytest

from gcs.cli import main
from gcs.formation.laws import registry
from gcs.model.errors import ShowError
from gcs.model.lifecycle import ShowPhase
from gcs.model.state import Array
from gcs.service import ShowAction
from gcs.shows import parse
from gcs.simulation.rehearsal import rehearse
from gcs.simulation.verdict import judge
from gcs.testing.virtual_show import VirtualShow
from tests.support.written_show import NAME, TEXT, config, fly, select

pytestmark = pytest.mark.long

SUPPORT = Path(__file__).parents[1] / "support"
AHEAD_RAD, OFF_RAD = 0.6, 0.1
STANDS = TEXT[: TEXT.index("  - {cue: walk")].replace("duration_s: 42.0", "duration_s: 10.0")


@pytest.fixture(autouse=True)
def _beside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_beside", [])
    registry.allow_code(SUPPORT)


def show_of(law: str, **settings: float | str) -> str:
    """A show that stands, with this law."""
    given = f"law_settings: {json.dumps(settings)}\n" if settings else ""
    return STANDS.replace("timeline:", f"law: '{law}'\n{given}timeline:")


def ahead_rad(place_m: Array, center_m: Array) -> Array:
    """(n,) angles of vehicles at (n, 3), as a ring of four shows them: below a fourth of a turn."""
    offset_m = place_m - center_m
    angle_rad: Array = np.arctan2(offset_m[:, 1], offset_m[:, 0]) % (np.pi / 2.0)
    return angle_rad


@pytest.mark.soak
def test_a_show_is_checked_and_flown_with_its_laws_settings(tmp_path: Path) -> None:
    text = show_of("ring_laws:RingById", ahead_rad=AHEAD_RAD)
    flight = rehearse(parse(text, NAME))
    verdict = judge(flight)
    assert verdict.good, verdict.problems
    assert [cue.radius_error_m is not None and cue.radius_error_m < 1.0 for cue in verdict.cues] == [True]
    ended = np.flatnonzero(np.array(flight.record.time_s) < flight.ended_s)[-1]
    angles_rad = ahead_rad(flight.record.position_m[ended], flight.record.center_m[ended])
    assert np.abs(angles_rad - AHEAD_RAD).max() < OFF_RAD

    async def story(show: VirtualShow) -> None:
        show_hash = select(show, text)
        await show.standby()
        show.service.commands.command_show(ShowAction.START, show_hash=show_hash)
        await show.reach(ShowPhase.RUNNING)
        await show.wait(5.0)
        assert np.abs(ahead_rad(show.true_m, np.array(show.view.center_m)) - AHEAD_RAD).max() < OFF_RAD
        await show.reach(ShowPhase.LANDED, 120.0)
        assert show.floor_violations() == 0

    usual = {"law": {"laws": {"ring_laws:RingById": {"ahead_rad": 0.0}}}}
    fly(story, config(tmp_path, control=usual), ideal=True)


def test_settings_belong_to_the_hash_of_a_show() -> None:
    shows = [parse(text, NAME).show for text in (STANDS, show_of("slots"), show_of("ring_laws:RingById"))]
    ahead = [parse(show_of("ring_laws:RingById", ahead_rad=value), NAME).show for value in (0.0, 0.1)]
    assert shows[0].digest == shows[1].digest
    assert len({show.digest for show in (*shows, *ahead)}) == 4


@pytest.mark.parametrize(
    ("law", "settings", "why"),
    [
        ("ring_laws:RingById", '{"ahead_rad": .nan}', r"ring_laws:RingById.ahead_rad = nan: a finite number"),
        ("ring_laws:RingById", "[1]", r"law_settings: a section is needed"),
        ("flocking", "{range_share: -1}", r"flocking.range_share = -1: .*greater than 0"),
        ("article", "{sphere_rate_per_s: 1}", r"article: its settings are those of control.law.article"),
        ("slots", "{sweeps: 3}", r"slots: its settings are those of control.law"),
        ("rnig", "{a: 1}", r"law = 'rnig': .*one of slots"),
    ],
)
def test_settings_that_a_law_cannot_have_are_named_by_line(law: str, settings: str, why: str) -> None:
    text = STANDS.replace("timeline:", f"law: '{law}'\nlaw_settings: {settings}\ntimeline:")
    with pytest.raises(ShowError, match=why):
        parse(text, NAME)


def test_settings_that_do_not_fit_a_law_are_named_by_line() -> None:
    text = show_of("ring_laws:RingById", ahaed_rad=1.0)
    line = text.splitlines().index('law_settings: {"ahaed_rad": 1.0}') + 1
    with pytest.raises(ShowError, match=rf"line {line}: law ring_laws:RingById: .*do not fit: ahaed_rad"):
        rehearse(parse(text, NAME))


@pytest.mark.soak
def test_a_show_whose_law_fails_is_not_good_to_fly() -> None:
    text = show_of("hostile_laws:Fails")
    verdict = judge(rehearse(parse(text, NAME)))
    assert not verdict.good
    problem = next(each for each in verdict.problems if "fails" in each.text)
    assert problem.line == text.splitlines().index("law: 'hostile_laws:Fails'") + 1
    assert problem.text.startswith("law hostile_laws:Fails fails 2 s after the assembly began: ZeroDivision")
    assert verdict.home_s is not None


@pytest.mark.soak
def test_a_law_without_a_goal_is_judged_by_no_sphere(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / f"{NAME}.yaml"
    file.write_text(show_of("flocking", range_share=1.6))
    assert main(["show", "check", str(file), "--json"]) == 0
    verdict = json.loads(capsys.readouterr().out)
    assert verdict["good"]
    assert [cue["radius_error_m"] for cue in verdict["cues"]] == [None]
    assert 15.0 <= verdict["assembled_s"] < 20.0
