"""The formation's law is chosen on the ground, flies the whole show, and is kept in flight."""

import json
from dataclasses import replace

import numpy as np
import pytest

from gcs.model.lifecycle import ShowPhase
from gcs.model.plan import Formation, Plan, plan_json, plan_of
from gcs.service import ShowAction
from gcs.simulation.batch import broken
from gcs.simulation.flight import prepared
from gcs.simulation.metrics import report
from gcs.simulation.scenario import Scenario
from gcs.testing.virtual_show import HEIGHT_M, RADIUS_M, VirtualShow, fly, refused, show_config


@pytest.mark.soak
@pytest.mark.parametrize("law", ["article", "neighbours"])
def test_law_chosen_on_the_ground_forms_the_sphere_and_rests(law: str) -> None:
    async def story(show: VirtualShow) -> None:
        chosen = Formation(RADIUS_M, HEIGHT_M, law=law)
        show.service.plan.set_formation(chosen)
        await show.start()
        await show.wait(45.0)  # four from a square leave its saddle after 25 s
        assert show.view.plan.formation.law == law
        last = show.track.between(show.now_s - 3.0)
        velocity_m_s = np.diff(last.true_m, axis=0) / np.diff(last.time_s)[:, None, None]
        velocity_m_s -= velocity_m_s.mean(axis=1, keepdims=True)  # the centre still moves to its target
        assert float(np.sqrt((velocity_m_s**2).sum(axis=2).mean())) < 0.1
        assert show.floor_violations() == 0
        refusal = await refused(show, lambda: show.service.plan.set_formation(replace(chosen, law="slots")))
        assert refusal.plan_kept
        assert refusal.text.startswith("cannot change the law while the show is running: stop it")
        show.service.plan.set_formation(replace(chosen, radius_m=RADIUS_M + 1.0))  # the law stays
        await show.show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED, 120.0)
        show.service.plan.set_formation(replace(chosen, law="slots"))

    fly(story, ideal=True)  # estimates that wander keep the vehicles moving: 0.3 m/s rms with a real PX4


def test_law_is_chosen_also_where_the_radius_has_become_small() -> None:
    """A choice of the law changes no distance; a radius too small for the accuracy blocks the start."""

    async def story(show: VirtualShow) -> None:
        show.befall("d2", "accuracy", eph_m=0.9, epv_m=1.2)
        await show.wait(3.0)
        chosen = replace(show.view.plan.formation, law="neighbours")
        refusal = await refused(show, lambda: show.service.plan.set_formation(replace(chosen, height_m=26.0)))
        assert "uncertain by 0.9" in refusal.text
        show.service.plan.set_formation(chosen)
        await show.until(lambda: show.view.plan.formation == chosen)

    formation = {"radius_m": 7.0, "height_m": 25.0}
    fly(story, show_config(8, formation=formation, positioning={"share": 1.0}), ideal=True)


@pytest.mark.soak
def test_law_is_in_the_configuration_and_in_the_record() -> None:
    plan = show_config(4, formation={"law": "neighbours"}).plan
    assert plan.formation.law == "neighbours"
    assert plan_of(json.loads(plan_json(plan)), 0.0) == plan
    assert Plan(Formation(5.0, 10.0)).formation.law == "slots"


@pytest.mark.soak
@pytest.mark.parametrize(("name", "count"), [("law-article", 8), ("law-neighbours", 8), ("carried", 20)])
def test_scenario_of_the_law_is_kept(name: str, count: int) -> None:
    record = prepared(Scenario.load(name), count, 3).fly()
    assert not broken(report(record), record.scenario.judged.must)
