"""The table over many runs: medians, worst cases, runs that never did, what failed."""

from typing import Any

from gcs.simulation.batch import passed, rows, summary
from tests.bench.flight_quality import markdown


def run(
    seed: int, settle_s: float | None, *, failed: tuple[str, ...] = (), vehicles: int = 4
) -> dict[str, Any]:
    return {
        "scenario": "trial",
        "vehicles": vehicles,
        "seed": seed,
        "realtime_factor": 100.0,
        "separation": {"floor_m": 2.0, "minimum_m": 3.0 + seed, "violations": 0, "lost_pairs": 0},
        "formation": {
            "settled": settle_s is not None,
            "settle_time_s": settle_s,
            "straight_line_time_s": 5.0,
            "radius_error_m": None,
            "energy_ratio": None,
            "nearest_ratio": None,
            "shape_error_m": None,
        },
        "tracking": {"orbit_radius_error_m": None, "spin_radius_error_m": None, "center_speed_m_s": None},
        "obstacles": dict.fromkeys(
            ("penetrations", "minimum_clearance_m", "reformed_time_s", "path_ratio", "noticed_s")
        ),
        "arrival": dict.fromkeys(("arrived", "median_ratio", "worst_ratio", "planning_s")),
        "tick": {"p50_ms": 0.1, "p99_ms": 0.2},
        "failed": list(failed),
        "missed": [],
    }


def test_one_row_for_each_scenario_and_fleet_median_and_worst() -> None:
    header, few, many = rows([run(0, 8.0), run(1, 9.0), run(2, 12.0), run(3, 7.0, vehicles=8)])
    assert dict(zip(header, few, strict=True)) == {
        "scenario": "trial",
        "N": "4",
        "runs": "3",
        "closest": "4.00/3.00",
        "viol.": "0",
        "settle": "9.0/12.0",
        "straight": "5.0",
        "p99 ms": "0.20",
        "x real": "100",
        "failed": "-",
    }
    assert many[:3] == ["trial", "8", "1"]


def test_pairs_of_two_lost_vehicles_have_a_column() -> None:
    runs = [run(0, 8.0), run(1, 9.0)]
    assert "lost p." not in rows(runs)[0]
    runs[1]["separation"]["lost_pairs"] = 2
    header, row = rows(runs)
    cells = dict(zip(header, row, strict=True))
    assert (cells["viol."], cells["lost p."]) == ("0", "1/2")


def test_the_planning_of_a_return_has_a_column() -> None:
    runs = [run(0, 8.0), run(1, 9.0)]
    assert "plan s" not in rows(runs)[0]
    for figures, planning_s in zip(runs, (2.0, 4.0), strict=True):
        figures["arrival"]["planning_s"] = planning_s
    header, row = rows(runs)
    assert dict(zip(header, row, strict=True))["plan s"] == "3.00/4.00"


def test_run_that_never_settled_is_the_worst() -> None:
    header, row = rows([run(0, 8.0), run(1, None, failed=("formation.settled False: at least 1",))])
    cells = dict(zip(header, row, strict=True))
    assert cells["settle"] == "8.0/never"
    assert cells["failed"] == "1"


def test_failures_are_reported_below_the_table() -> None:
    text = summary([run(7, None, failed=("formation.settled False: at least 1",))])
    assert "trial seed 7: formation.settled False: at least 1" in text


def test_a_document_gets_the_same_cells() -> None:
    lines = markdown([run(0, 8.0)]).splitlines()
    assert lines[0].startswith("| scenario | N | runs |")
    assert lines[1].startswith("| --- | ---: |")
    assert "| 8.0 |" in lines[2]


def test_one_in_twenty_may_miss_demands_on_most_none_on_all() -> None:
    runs = [run(seed, 8.0) for seed in range(20)]
    assert passed(runs)
    runs[3]["missed"] = ["formation.in_time False: at least 1"]
    assert passed(runs)
    runs[4]["missed"] = ["formation.in_time False: at least 1"]
    assert not passed(runs)
    assert not passed([run(1, 8.0, failed=("separation.violations 1: at most 0",))])
