"""A flight knows no site: nothing in it is named after one, and alone no vehicle is elsewhere."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from gcs.flight.state.elsewhere import Elsewhere, Returning
from gcs.model.state import VehicleId

ROOT = Path(__file__).parents[3]
MODULES = sorted(
    path for name in ("control", "flight", "simulation") for path in (ROOT / "gcs" / name).rglob("*.py")
)
OF_THE_PORT = {"stations", "site"}  # roles of `gcs.service.Service`: of other stations, and of areas
WORDS = {"site", "sites", "station", "stations", "membership"}
OF_PLACES = re.compile(  # where vehicles land, and the areas in which they fly
    r"landing_sites?|sites?_m$|flight_site|(?:Flight|Drawn|Random)Site"
    r"|Site(?:Area|Corner|Editor|Error|Figures|File|Format|View)"
    r"|site_(?:editor|figures|files|hash|view)|(?:drawn|read|within)_site|NO_SITE|ground_for_sites"
)


def identifiers(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        match node:
            case ast.Name(id=name) | ast.Attribute(attr=name) | ast.arg(arg=name) | ast.alias(name=name):
                yield name
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                yield name


def words(name: str) -> set[str]:
    """The words of an identifier in snake or camel case, without those of places."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", OF_PLACES.sub("", name)).lower()
    return set(re.split(r"[_.]+", spaced))


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_no_identifier_names_a_station(path: Path) -> None:
    named = {
        name
        for name in identifiers(path)
        if words(name) & WORDS and name.strip("_").lower() not in OF_THE_PORT
    }
    assert named == set()


def test_alone_every_vehicle_is_its_own() -> None:
    alone = Elsewhere(3)
    assert alone.owned.tolist() == [True] * 3
    assert alone.alone
    assert alone.all_up
    assert alone.hooks.may_send
    assert not alone.lead_runs
    assert alone.others is None
    assert alone.shared() is None


def test_alone_no_vehicle_is_elsewhere() -> None:
    alone, none = Elsewhere(2), Returning.none()
    position_m, charge = alone.formed_m()
    assert position_m.shape == (0, 3)
    assert charge.shape == alone.uncertainty_m().shape == (0,)
    assert alone.landing_m().shape == alone.taken_m(none).shape == (0, 2)
    assert alone.closed()[0].shape == (0, 2, 3)
    assert alone.returns.plans_returns is None
    assert alone.returns.stands(0.1)
    assert np.isnan(alone.returns.led_s())


def test_alone_the_show_is_led_here() -> None:
    shows = Elsewhere(2).shows
    chosen: tuple[VehicleId, ...] = ("d2", "d1")
    assert shows.leads
    assert not shows.follow()
    assert shows.starting(chosen) == chosen
    assert shows.rows(chosen) == {"d2": 0, "d1": 1}
    assert shows.start_too(named=False) == shows.count == 0
