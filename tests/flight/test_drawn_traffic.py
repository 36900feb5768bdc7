"""In drawn shows vehicles that pass at the spacing of the show do not slow down for each other."""

from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from gcs.shows import LoadedShow, parse
from gcs.shows.formats import read_drawing, write_drawing
from gcs.shows.importing import show_text
from gcs.simulation.metrics import separation
from gcs.simulation.rehearsal import Rehearsal
from gcs.simulation.scenario import World
from tests.support.drawn_traffic import traffic_show

pytestmark = pytest.mark.soak

SPACING_M = 3.0
RMS_M, MOST_M = 0.3, 1.5

SEEDS = range(100)
FEW = 1


def loaded(folder: Path, seed: int) -> LoadedShow:
    drawing, path = folder / "traffic.skyc", folder / "traffic.yaml"
    write_drawing(traffic_show(seed, SPACING_M), drawing)
    drawn, data = read_drawing(drawing)
    path.write_text(show_text(drawn, drawing.name, sha256(data).hexdigest()))
    return parse(path.read_text(), str(path))


@pytest.mark.parametrize(
    "seed", [pytest.param(seed, marks=pytest.mark.soak if seed >= FEW else ()) for seed in SEEDS]
)
def test_vehicles_pass_at_the_drawn_spacing_without_a_delay(seed: int, tmp_path: Path) -> None:
    run = Rehearsal(loaded(tmp_path, seed), World(), seed)
    record = run.fly()
    assert separation(record).violations == 0
    assert run.errors.fleet_rms_m <= RMS_M
    assert float(np.max(run.errors.max_m)) <= MOST_M
    assert not run.flaws
