"""A show that names a drawing is stored with it, listed, checked and removed."""

import asyncio
from collections.abc import Coroutine
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

from gcs.cli.main import main
from gcs.config import schema
from gcs.config.sections import OperationSettings
from gcs.config.yaml_files import shipped_folder
from gcs.control import ControlSettings
from gcs.model.errors import InvalidError, RefusedError, UnknownError
from gcs.service import CheckState, ShowCheck
from gcs.shows import stored_drawings
from gcs.shows.formats import parse_drawing
from gcs.shows.importing import show_text
from gcs.shows.library import ShowLibrary
from gcs.shows.loading import load, service_flaws
from gcs.shows.service_rules import ServiceRules

pytestmark = pytest.mark.usefixtures("prompt_checks")

GIVEN = shipped_folder() / "shows" / "drawn-30.skyc"


def text_for(source: str) -> bytes:
    data = GIVEN.read_bytes()
    return show_text(parse_drawing(data, source), source, sha256(data).hexdigest()).encode()


TEXT = text_for("night.skyc")


@pytest.fixture
def library(tmp_path: Path) -> ShowLibrary:
    return ShowLibrary(tmp_path / "shows")


def done(call: Coroutine[Any, Any, Any]) -> Any:
    return asyncio.run(call)


def files(library: ShowLibrary, tmp_path: Path) -> list[str]:
    return sorted(path.name for path in (tmp_path / "shows").iterdir())


@pytest.mark.parametrize(
    ("text", "source"),
    [
        ("drawing: {source: a.skyc, sha256: 0}\n", "a.skyc"),
        ("about: x\ndrawing: {sha256: 0, source: 'a-b.zip'}\n", "a-b.zip"),
        ("drawing:\n  # of May\n  sha256: 0\n  source: a.csv\nfleet: {}\n", "a.csv"),
        ("about: x\nfleet: {source: a.skyc}\n", None),
        ("drawing: {source: ../a.skyc}\n", None),
        ("drawing: {}\nother:\n  source: a.skyc\n", None),
        ("drawing: {source: a.skyc.yaml}\n", None),
    ],
)
def test_the_drawing_is_found_in_a_shows_text(text: str, source: str | None) -> None:
    assert stored_drawings.source_of(text.encode()) == source


def test_a_drawn_show_is_kept_and_listed(library: ShowLibrary, tmp_path: Path) -> None:
    stored = done(library.store_drawn("night", TEXT, GIVEN))
    assert stored.drawing == "night.skyc"
    assert done(library.list_shows()) == [stored]
    assert (tmp_path / "shows" / "night.skyc").read_bytes() == GIVEN.read_bytes()
    assert done(library.drawn_file("night")) == tmp_path / "shows" / "night.yaml"


@pytest.mark.parametrize(
    "configured",
    [
        {"operation": {"takeoff_height_m": 8.0, "takeoff_stagger_s": 0.5}},
        {
            "control": {
                "safety": {"fence": {"height_min_m": 4.5, "height_max_m": 31.0, "distance_max_m": 40.0}}
            }
        },
        {"control": {"safety": {"limits": {"horizontal_m_s": 6.0, "up_m_s": 2.4, "down_m_s": 1.35}}}},
        {"control": {"safety": {"floor": {"horizontal_m": 2.5, "vertical_m": 3.75}}}},
        {"operation": {"setpoint_loss_action": "return"}},
    ],
)
def test_a_drawing_gets_the_rules_of_the_station(configured: dict[str, Any], tmp_path: Path) -> None:
    """What a service writes, it flies: no key of the file is at odds with its configuration."""
    control = ControlSettings.model_validate(configured.get("control", {}))
    usual = {"takeoff_height_m": 5.0, "takeoff_stagger_s": 2.0}
    operation = OperationSettings.model_validate(usual | configured.get("operation", {}))
    library = ShowLibrary(tmp_path / "shows", ServiceRules.of(control, operation))
    rules = ["--rules", library.rules]
    assert main(["show", "import", str(GIVEN), "-o", str(tmp_path / "night.yaml"), *rules, "--json"]) == 0
    show = load(tmp_path / "night.yaml").show
    assert service_flaws(show, show.origin.frame, control, operation, 30) == []
    place = ["show", "place", str(tmp_path / "night.yaml"), "--at", "1,2,3", *rules]
    assert main([*place, "-o", str(tmp_path / "b.yaml")]) == 0
    (tmp_path / "b.yaml").rename(tmp_path / "night.yaml")
    placed = load(tmp_path / "night.yaml").show
    assert service_flaws(placed, placed.origin.frame, control, operation, 30) == []


def test_placing_takes_over_a_changed_take_off(tmp_path: Path) -> None:
    """The service was configured anew after the upload: Apply writes a file that it flies."""
    control = ControlSettings()
    first, second = (
        OperationSettings(takeoff_height_m=height_m, takeoff_stagger_s=stagger_s)
        for height_m, stagger_s in ((5.0, 1.0), (6.5, 0.5))
    )
    show = tmp_path / "night.yaml"
    assert (
        main(["show", "import", str(GIVEN), "-o", str(show), "--rules", _rules(control, first), "--json"])
        == 0
    )
    found = load(show).show
    assert len(service_flaws(found, found.origin.frame, control, second, 30)) == 2
    assert (
        main(["show", "place", str(show), "--rules", _rules(control, second), "-o", str(show), "--json"]) == 0
    )
    found = load(show).show
    assert service_flaws(found, found.origin.frame, control, second, 30) == []


def _rules(control: ControlSettings, operation: OperationSettings) -> str:
    return ServiceRules.of(control, operation).model_dump_json()


def test_an_import_for_a_configuration_agrees_with_it(tmp_path: Path) -> None:
    target = tmp_path / "night.yaml"
    assert main(["show", "import", str(GIVEN), "-o", str(target), "--config", "px4-sitl", "--json"]) == 0
    config, show = schema.load(schema.find("px4-sitl")), load(target).show
    assert show.fleet.takeoff_stagger_s == config.operation.takeoff_stagger_s == 2.0
    assert service_flaws(show, show.origin.frame, config.control, config.operation, 30) == []


def test_a_drawing_goes_with_the_last_show_of_it(library: ShowLibrary, tmp_path: Path) -> None:
    done(library.store_drawn("night", TEXT, GIVEN))
    done(library.store("again", TEXT))
    done(library.remove("night"))
    assert files(library, tmp_path) == ["again.yaml", "night.skyc"]
    done(library.remove("again"))
    assert files(library, tmp_path) == []


def test_an_import_replaces_the_drawing_before(library: ShowLibrary, tmp_path: Path) -> None:
    done(library.store_drawn("night", TEXT.replace(b"night.skyc", b"old.skyc"), GIVEN))
    done(library.store_drawn("night", TEXT, GIVEN))
    assert files(library, tmp_path) == ["night.skyc", "night.yaml"]


def test_a_show_without_a_drawing_is_refused(library: ShowLibrary, tmp_path: Path) -> None:
    with pytest.raises(InvalidError, match="names its drawing"):
        done(library.store_drawn("night", b"about: x\n", GIVEN))
    done(library.store("plain", b"about: x\n"))
    with pytest.raises(RefusedError, match="has no drawing"):
        done(library.drawn_file("plain"))
    with pytest.raises(UnknownError, match="no show 'night'"):
        done(library.drawn_file("night"))


def test_too_large_a_drawing_changes_nothing(
    library: ShowLibrary, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done(library.store_drawn("night", TEXT, GIVEN))
    kept = files(library, tmp_path)
    monkeypatch.setattr(stored_drawings, "ALL_MAX_BYTES", 100_000)
    with pytest.raises(RefusedError, match="at most 100000; remove a show"):
        done(library.store_drawn("second", text_for("second.skyc"), GIVEN))
    monkeypatch.setattr(stored_drawings, "DRAWING_MAX_BYTES", 10)
    with pytest.raises(RefusedError, match="at most 10 are accepted"):
        done(library.store_drawn("night", TEXT, GIVEN))
    with pytest.raises(RefusedError, match="cannot be kept: No such file"):
        done(library.store_drawn("third", text_for("third.skyc"), tmp_path / "none.skyc"))
    assert files(library, tmp_path) == kept


def test_a_drawing_that_has_changed_fails_the_check(library: ShowLibrary, tmp_path: Path) -> None:
    done(library.store_drawn("night", TEXT, GIVEN))

    async def checked() -> ShowCheck:
        library.check("night")
        async with asyncio.timeout(240):
            while library.checked("night").state in {CheckState.WAITING, CheckState.RUNNING}:  # noqa: ASYNC110
                await asyncio.sleep(0.05)
        return library.checked("night")

    done(library.store("night", TEXT.replace(sha256(GIVEN.read_bytes()).hexdigest().encode(), b"0" * 64)))
    found = done(checked())
    assert (found.state, found.good) == (CheckState.DONE, False)
    assert "night.skyc has" in found.problems[0].text
    assert "it has changed, import it again" in found.problems[0].text
