import json
import re
from dataclasses import replace
from math import nan
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from gcs.model.lifecycle import Phase
from gcs.service.alarms import AlarmCause, Condition
from gcs.service.features import Features, TargetsView, TargetView
from tests.support.api_fake_service import FakeService
from tests.support.api_harness import Api

DASHBOARD = Path(__file__).parents[3] / "docs" / "grafana" / "formation.json"


@pytest.fixture
def samples() -> dict[tuple[str, ...], float]:
    """Every sample by its name and the values of its labels, of a fleet of three that flies but for one."""
    service = FakeService()
    service.fly()
    service.phases["d3"] = Phase.LOST
    service.tick()
    answer = Api(service)("GET", "/metrics")
    assert answer.headers["content-type"].startswith("text/plain; version=")
    return {
        (sample.name, *sample.labels.values()): sample.value
        for family in text_string_to_metric_families(answer.text)
        for sample in family.samples
    }


def test_metrics_report_the_fleet(samples: dict[tuple[str, ...], float]) -> None:
    assert samples["gcs_control_alive",] == 1.0
    assert samples["gcs_show_phase", "running"] == 1.0
    assert sum(value for key, value in samples.items() if key[0] == "gcs_show_phase") == 1.0
    assert samples["gcs_vehicles", "formation"] == 2.0
    assert samples["gcs_vehicles", "lost"] == 1.0
    assert samples["gcs_minimum_separation_meters",] == 5.0
    assert samples["gcs_filter_interventions_total",] == 7.0
    assert samples["gcs_late_samples_total",] == 4.0
    assert samples["gcs_setpoints_sent_total",] == samples["gcs_ticks_total",] * 3
    assert samples["gcs_vehicle_link_quality", "d1"] == 0.75
    assert samples["gcs_vehicle_position_age_seconds", "d2"] == 0.05
    assert (samples["gcs_vehicle_limited", "d1"], samples["gcs_vehicle_limited", "d2"]) == (1.0, 0.0)
    assert samples["gcs_vehicle_ready", "d3"] == 0.0
    assert samples["gcs_lights_info", "led-control"] == 1.0
    assert (samples["gcs_lights_sent_total",], samples["gcs_lights_dropped_total",]) == (120.0, 30.0)


def test_alarm_counts_by_severity_with_the_overall_state() -> None:
    service = FakeService()
    service.conditions = (
        Condition(AlarmCause.LOW_BATTERY, "battery at 15%", ("d2",)),
        Condition(AlarmCause.VEHICLE_LOST, "no telemetry for 2.0 s", ("d1", "d3")),
        Condition(AlarmCause.SERVICE_NOTE, "no map"),
    )
    service.tick()
    lines = Api(service)("GET", "/metrics").text.splitlines()
    assert 'formation_alarms{severity="warning"} 2.0' in lines
    assert 'formation_alarms{severity="emergency"} 0.0' in lines
    assert 'formation_state{severity="warning"} 1.0' in lines
    assert 'formation_state{severity="normal"} 0.0' in lines
    assert 'formation_alarm{cause="vehicle-lost"} 1.0' in lines
    assert sum(line.startswith("formation_alarm{") for line in lines) == len(AlarmCause)
    assert "formation_alarms_unacknowledged 3.0" in lines


def test_the_histograms_are_those_of_the_ticks(samples: dict[tuple[str, ...], float]) -> None:
    buckets = [samples["gcs_tick_duration_seconds_bucket", bound] for bound in ("0.01", "0.1", "+Inf")]
    assert buckets == [3.0, 5.0, 6.0]
    assert samples["gcs_tick_duration_seconds_sum",] == 0.5
    assert samples["gcs_tick_lateness_seconds_count",] == 6.0


def test_metrics_report_the_selected_target() -> None:
    numbers = {"rate_hz": 5.0, "x_m": 1.0, "y_m": 2.0, "velocity_x_m_s": 0.0, "velocity_y_m_s": 0.0}
    boat = TargetView(
        "boat",
        "rest",
        "coasting",
        "",
        0.5,
        deviation_m=1.5,
        height_m=nan,
        clearance_m=0.0,
        reports=9,
        refused=0,
        **numbers,
    )
    buoy = replace(boat, name="buoy", state="lost", age_s=60.0)
    service = FakeService()
    service.features = Features(targets=TargetsView("boat", (buoy, boat), off_m=nan))
    service.tick()
    lines = Api(service)("GET", "/metrics").text.splitlines()
    assert 'gcs_target_info{selected="boat"} 1.0' in lines
    assert 'gcs_target_state{state="coasting"} 1.0' in lines
    assert 'gcs_target_state{state="lost"} 0.0' in lines
    assert "gcs_target_age_seconds 0.5" in lines
    assert "gcs_target_deviation_meters 1.5" in lines
    assert "gcs_target_distance_meters NaN" in lines


def test_unknown_metrics_are_absent() -> None:
    api = Api()
    text = api("GET", "/metrics").text
    assert "gcs_minimum_separation_meters" not in {line.split(" ")[0] for line in text.splitlines()}
    assert "nan" not in text.lower()


def test_a_dead_control_loop_is_reported() -> None:
    api = Api()
    api.service.control_alive = False
    api.service.tick()
    assert "gcs_control_alive 0.0" in api("GET", "/metrics").text


def test_dashboard_uses_only_reported_metrics(samples: dict[tuple[str, ...], float]) -> None:
    reported = {name for name, *_ in samples}
    panels = json.loads(DASHBOARD.read_text())["panels"]
    expressions = [target["expr"] for panel in panels for target in panel.get("targets", [])]
    asked = {name for expression in expressions for name in re.findall(r"\bgcs_\w+", expression)}
    assert len(asked) > 10
    assert asked <= reported
    # Over at least two scrapes, whatever their interval: a fixed [10s] shows nothing at 15 s.
    windows = re.findall(r"\[[^\]]+\]", " ".join(expressions))
    assert windows
    assert set(windows) <= {"[$__rate_interval]", "[5m]"}
    assert len({panel["id"] for panel in panels}) == len(panels)
