"""`site: FILE` of a configuration: read beside it, in the fence, and kept with it in records."""

from pathlib import Path

import pytest
import yaml

from gcs.areas.files.site_files import written
from gcs.areas.site import AreaKind, FlightSite
from gcs.config.schema import Config, load, parse
from gcs.model.errors import ConfigError
from gcs.model.frames import ShowFrame
from tests.support.fields import ELL, area, field

ROOT = Path(__file__).parents[3]
DEMO = (ROOT / "configs" / "demo.yaml").read_text(encoding="utf-8")


def configured(folder: Path, more: str = "site: field.geojson\n") -> Path:
    (folder / "field.geojson").write_bytes(written(field(top_m=60.0), Path("field.geojson")))
    path = folder / "show.yaml"
    path.write_text(DEMO + more)
    return path


def test_the_fence_has_the_areas_of_the_site(tmp_path: Path) -> None:
    config = load(configured(tmp_path))
    fence = config.control.safety.fence
    assert config.site == tmp_path / "field.geojson"
    assert config.flight_site == field(top_m=60.0)
    assert [area.inside for area in fence.areas] == [True, False]
    assert fence.height_max_m == 60.0
    assert Config.model_validate(config.model_dump(mode="json")) == config


def test_without_a_site_nothing_changes() -> None:
    config = parse(DEMO, "demo.yaml")
    assert config.flight_site is None
    assert config.control.safety.fence.areas == ()


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("site: none.geojson\n", "line 29: .*none.geojson: cannot be read: No such file"),
        ("site: {file: a}\n", "line 29: site: the name of a site's file is needed"),
        ("flight_site: {}\n", "line 29: flight_site: the name of a site's file is needed"),
        ("site: far.geojson\n", "line 29: .*origin of the show frame: it is another field"),
        ("site: field.geojson\noperation2: {}\n", "line 30: operation2"),
    ],
)
def test_a_wrong_site_is_an_error_of_its_line(tmp_path: Path, more: str, words: str) -> None:
    there = ShowFrame(50.0, 8.0, 0.0)
    far = FlightSite("far", (area(AreaKind.FLIGHT_GEOGRAPHY, ELL, (0.0, 45.0), frame=there),))
    (tmp_path / "far.geojson").write_bytes(written(far, Path("far.geojson")))
    with pytest.raises(ConfigError, match=words):
        load(configured(tmp_path, more))


def test_a_plan_that_does_not_fit_is_refused_with_the_metres(tmp_path: Path) -> None:
    """The sphere of the first plan lies inside the site, or the service does not begin."""
    moved = DEMO.replace("target: {x_m: 6.0, y_m: 4.0}", "target: {x_m: 50.0, y_m: 30.0}")
    path = configured(tmp_path)
    path.write_text(moved + "site: field.geojson\n")
    with pytest.raises(
        ConfigError, match=r"line 18: target: .*m are missing to area 1 of the fence, which vehicles stay"
    ):
        load(path)


def test_a_site_that_was_not_read_is_no_configuration() -> None:
    """Whoever makes a configuration without its file would fly without its areas."""
    with pytest.raises(ValueError, match="it is read with its file"):
        Config.model_validate(yaml.safe_load(DEMO) | {"site": "field.geojson"})
