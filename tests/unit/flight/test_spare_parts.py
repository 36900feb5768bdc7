"""Spares of a drawn show: until when a lost vehicle is replaced, and which spare gets its part."""

from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
import yaml

from gcs.config.yaml_files import shipped_folder
from gcs.flight.commands.spares import climb_is_free, replacements
from gcs.flight.state.running_show import ShowRun
from gcs.shows import ShowClock, parse
from gcs.shows.formats import parse_drawing
from gcs.shows.importing import show_text

NAMES = tuple(f"d{number}" for number in range(1, 31))


@pytest.fixture
def show_run(tmp_path: Path) -> ShowRun:
    """The shipped drawing with two spares before '2 rings', at 20.4 s."""
    data = (shipped_folder() / "shows" / "drawn-30.skyc").read_bytes()
    (tmp_path / "a.skyc").write_bytes(data)
    raw = yaml.safe_load(show_text(parse_drawing(data, "a.skyc"), "a.skyc", sha256(data).hexdigest()))
    raw["drawing"]["spares"] = {"count": 2, "before_cue": "2 rings"}
    timeline = parse(yaml.safe_dump(raw), str(tmp_path / "a.yaml")).timeline
    run = ShowRun("a", timeline, spares=("d31", "d32"))
    run.assign(NAMES, np.zeros((30, 3)))
    return run


def test_a_vehicle_is_replaced_up_to_the_cue_only(show_run: ShowRun) -> None:
    show_run.clock = ShowClock(20.3)
    assert show_run.takes_spares(0.0)
    show_run.clock = ShowClock(20.5)
    assert not show_run.takes_spares(0.0)


def test_a_spare_gets_the_part_of_the_lost_vehicle(show_run: ShowRun) -> None:
    part = show_run.parts["d7"]
    show_run.replace("d7", "d31")
    assert "d7" not in show_run.parts
    assert (show_run.parts["d31"], show_run.view(0.0).spares) == (part, ("d32",))


def test_a_spare_that_stays_down_leaves_the_part_to_another(show_run: ShowRun) -> None:
    part = show_run.parts["d7"]
    show_run.replace("d7", "d31")
    show_run.give_back("d31", "d7")
    assert show_run.parts["d7"] == part
    assert "d31" not in (*show_run.parts, *show_run.spares)


def test_each_lost_vehicle_gets_another_spare_that_may_climb(show_run: ShowRun) -> None:
    def replaced(*ready: str) -> list[tuple[str, str]]:
        return list(replacements(show_run, 0.0, ("d7", "d9", "d40"), lambda name: name in ready))

    assert replaced("d32") == [("d7", "d32")]
    assert replaced() == []
    assert replaced("d31", "d32") == [("d9", "d31")]


@pytest.mark.parametrize(
    ("other_m", "free"),
    [
        ((5.9, 0.0, -8.0), False),
        ((6.1, 0.0, -8.0), True),
        ((0.0, 0.0, -10.9), False),  # 5 m of climb and 6 m above it
        ((0.0, 0.0, -11.1), True),
        ((np.nan, np.nan, np.nan), True),
    ],
)
def test_a_spare_climbs_where_no_other_is_near(other_m: tuple[float, float, float], free: bool) -> None:
    far_m = (40.0, 0.0, -8.0)
    assert climb_is_free(np.zeros(3), np.array([far_m, other_m]), 5.0) is free
