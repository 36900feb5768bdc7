"""A show of the law is exported as it flies: positions and lights of its rehearsal."""

from pathlib import Path

import numpy as np
import pytest

from gcs.shows.formats import read_drawing, write_drawing
from gcs.simulation.drawn_flight import drawn
from gcs.simulation.rehearsal import rehearse
from tests.support.show_files import loaded

pytestmark = pytest.mark.soak


def test_an_exported_rehearsal_is_where_the_vehicles_were(tmp_path: Path) -> None:
    fleet = {"vehicles": 4, "pads": {"columns": 2, "spacing_m": 5.0}, "endurance_s": 900.0}
    lit = {"cue": "light", "at_s": 6, "lights": ["#ff0000"], "over_s": 1}
    flight = rehearse(loaded(lit, fleet=fleet, duration_s=10.0))
    write_drawing(drawn(flight), tmp_path / "a.skyc")
    show, _ = read_drawing(tmp_path / "a.skyc")
    times_s = np.array(flight.record.time_s) - flight.record.time_s[0]
    apart_m = show.trajectories.positions_m(times_s) - flight.record.path_m
    assert np.linalg.norm(apart_m, axis=2).max() < 0.05
    assert flight.began_s is not None
    began_s = flight.began_s - flight.record.time_s[0]
    assert show.lights.colours_at(began_s + 5.0).max() == 0
    assert show.lights.colours_at(began_s + 8.0).tolist() == [[255, 0, 0]] * 4
    assert [cue.at_s for cue in show.cues] == pytest.approx([began_s, began_s + 6.0], abs=0.01)
    assert show.trajectories.at(show.duration_s).position_m[:, 2] == pytest.approx(np.zeros(4), abs=0.3)
