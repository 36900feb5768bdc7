import math

import pytest
from rich.console import Console

from gcs.api.context import Feed
from gcs.api.schemas import convert
from gcs.api.schemas import fleet as schemas
from gcs.cli.status import board
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Direction, Formation, YawPolicy
from gcs.service import Features, Outcome, ShowAction, VehicleAction
from gcs.service.alarms import AlarmCause, Condition
from gcs.service.features import CorrectionsView
from tests.support.api_fake_service import FakeService
from tests.support.api_harness import Api

BOX = {"x_m": 50.0, "y_m": 0.0, "half_length_x_m": 2.0, "half_length_y_m": 3.0, "height_m": 15.0}


@pytest.fixture
def api() -> Api:
    return Api()


def test_fleet_snapshot_is_of_one_instant(api: Api) -> None:
    api.service.fly()
    fleet = api("GET", "/api/v1/fleet").json()
    assert fleet["control_alive"] is True
    assert fleet["show"] == {
        "phase": "running",
        "reason": "",
        "possible": ["stop", "pause", "abort"],
        "start_refused": "",
        "selected": None,
        "start_unix_time_s": None,
        "countdown_s": None,
    }
    assert fleet["formation"] == {
        "radius_m": 10.0,
        "height_m": 20.0,
        "radius_now_m": 9.0,
        "height_now_m": 20.0,
        "law": "slots",
    }
    assert fleet["center"]["height_m"] == 20.0
    assert fleet["center"]["altitude_amsl_m"] == pytest.approx(508.0, abs=0.01)
    assert [fleet["center"][name] for name in ("vx_m_s", "vy_m_s", "vup_m_s")] == [0.5, 0.0, 0.0]
    assert [each["id"] for each in fleet["vehicles"]] == ["d1", "d2", "d3"]
    assert fleet["tick"]["rate_hz"] == 20.0
    assert fleet["origin"]["heading_deg"] == 90.0
    assert fleet["obstacles"] == []
    assert fleet["setpoints_sent"] == 3


def test_gcs_status_shows_the_alarms_on_top(capsys: pytest.CaptureFixture[str]) -> None:
    service = FakeService()
    service.fly()
    because, follows = "battery at 15%, below 20%", "It comes home."
    service.conditions = (Condition(AlarmCause.LOW_BATTERY, because, ("d2",), follows, command_id="o3"),)
    service.tick()
    fleet = schemas.Fleet.model_validate(Api(service)("GET", "/api/v1/fleet").json())
    Console(width=80).print(board(fleet, 80))
    reported = capsys.readouterr().out.splitlines()
    assert reported[0].split() == ["WARNING", "1", "alarm,", "1", "not", "acknowledged"]
    assert reported[1].split()[0] == "warning"
    assert "Vehicle d2 low on battery: battery at 15%" in reported[1]


def test_unknown_value_is_null_and_never_nan(api: Api) -> None:
    api.service.phases["d1"] = Phase.LOST
    api.service.tick()
    answer = api("GET", "/api/v1/fleet")
    assert "NaN" not in answer.text
    assert "Infinity" not in answer.text
    assert answer.json()["tick"]["duration_p50_ms"] is None
    lost = answer.json()["vehicles"][0]
    assert (lost["vx_m_s"], lost["heading_deg"], lost["heartbeat_age_s"]) == (None, None, None)
    assert {lost[name] for name in ("x_m", "y_m", "height_m", "latitude_deg", "altitude_amsl_m")} == {None}
    assert answer.json()["center"] is None


def test_heights_are_positive_up_and_headings_from_north(api: Api) -> None:
    api.service.fly()
    vehicle = api("GET", "/api/v1/vehicles/d2").json()
    assert vehicle["height_m"] == 20.0
    assert vehicle["vup_m_s"] == -0.3
    assert [vehicle[f"setpoint_{axis}_m_s"] for axis in ("x", "y", "up")] == [1.0, 0.0, 1.0]
    assert vehicle["heading_deg"] == 90.0  # yaw 0 is the show's heading, which is east here
    assert vehicle["landed"] == "in_air"


def test_vehicles_are_listed_and_an_unknown_one_is_named(api: Api) -> None:
    assert [each["phase"] for each in api("GET", "/api/v1/vehicles").json()] == ["standby"] * 3
    missing = api("GET", "/api/v1/vehicles/d9")
    assert missing.status_code == 404
    assert missing.json() == {
        "detail": "there is no vehicle 'd9'; there are d1, d2, d3",
        "problems": [],
    }


@pytest.mark.parametrize(
    ("action", "before", "after"),
    [
        (VehicleAction.HOLD, Phase.FORMATION, Phase.HOLD),
        (VehicleAction.JOIN, Phase.HOLD, Phase.FORMATION),
        (VehicleAction.RETURN, Phase.FORMATION, Phase.RETURN),
        (VehicleAction.LAND, Phase.FORMATION, Phase.LANDING),
        (VehicleAction.TAKE_CONTROL, Phase.PILOT, Phase.HOLD),
        (VehicleAction.CONFIRM_DOWN, Phase.LOST, Phase.OFFLINE),
    ],
)
def test_vehicle_command_is_accepted_with_an_id(
    api: Api, action: VehicleAction, before: Phase, after: Phase
) -> None:
    api.service.phases["d2"] = before
    answer = api("POST", f"/api/v1/vehicles/d2/{action}")
    assert answer.status_code == 202
    assert answer.headers["location"] == f"/api/v1/commands/{answer.json()['id']}"
    assert answer.json()["outcomes"] == {"d2": {"outcome": "pending", "reason": ""}}
    assert api.service.phases["d2"] is after


@pytest.mark.parametrize(
    "action", sorted(set(VehicleAction) - {VehicleAction.CONFIRM_DOWN, VehicleAction.FIND})
)
def test_command_to_a_selection_names_those_not_reached(api: Api, action: VehicleAction) -> None:
    before = {VehicleAction.JOIN: Phase.HOLD, VehicleAction.TAKE_CONTROL: Phase.PILOT}
    api.service.phases["d2"] = before.get(action, Phase.FORMATION)
    answer = api("POST", f"/api/v1/fleet/{action}", json={"vehicles": ["d1", "d2"]})
    assert answer.status_code == 202
    assert answer.headers["location"] == f"/api/v1/commands/{answer.json()['id']}"
    parts = answer.json()["outcomes"]
    assert parts["d2"] == {"outcome": "pending", "reason": ""}
    assert parts["d1"]["outcome"] == "not-included"
    assert "standby" in parts["d1"]["reason"]
    assert api("POST", f"/api/v1/fleet/{action}", json={"vehicles": ["d1"]}).status_code == 409
    assert api("POST", f"/api/v1/fleet/{action}", json={"vehicles": ["d9"]}).status_code == 404
    assert api("POST", f"/api/v1/fleet/{action}", json={"vehicles": []}).status_code == 422


def test_lost_vehicle_and_those_on_pads_are_not_airborne(api: Api) -> None:
    api.service.phases |= {"d1": Phase.FORMATION, "d2": Phase.LOST, "d3": Phase.STANDBY}
    api.service.tick()
    desired = {"airborne": 1, "controlled": 1, "uncontrolled": 0, "unknown": 1, "on_ground": 1, "offline": 0}
    assert api("GET", "/api/v1/fleet").json()["counts"] == desired
    assert api("GET", "/api/v1/status").json()["counts"] == desired


def test_find_is_a_command_that_is_done_at_once(api: Api) -> None:
    answer = api("POST", "/api/v1/vehicles/d2/find")
    assert answer.status_code == 202
    assert answer.json()["outcomes"] == {"d2": {"outcome": "done", "reason": ""}}
    assert api("POST", "/api/v1/vehicles/d9/find").status_code == 404
    assert api("POST", "/api/v1/fleet/find").status_code == 404


def test_every_vehicle_and_show_action_has_a_route(api: Api) -> None:
    paths = api("GET", "/openapi.json").json()["paths"]
    assert all(f"/api/v1/vehicles/{{vehicle_id}}/{action}" in paths for action in VehicleAction)
    assert all(f"/api/v1/show/{action}" in paths for action in ShowAction)


def test_a_command_in_the_wrong_phase_is_refused_with_the_reason(api: Api) -> None:
    answer = api("POST", "/api/v1/vehicles/d1/join")
    assert answer.status_code == 409
    assert answer.json()["detail"] == "'engage' is not possible while standby; it is from hold"


@pytest.mark.parametrize(
    ("action", "before", "after", "again"),
    [
        ("start", ShowPhase.IDLE, ShowPhase.PREFLIGHT, 409),
        ("stop", ShowPhase.RUNNING, ShowPhase.RETURNING, 202),
        ("pause", ShowPhase.RUNNING, ShowPhase.PAUSED, 202),
        ("resume", ShowPhase.PAUSED, ShowPhase.ASSEMBLING, 409),
        ("abort", ShowPhase.RUNNING, ShowPhase.ABORTING, 202),
    ],
)
def test_show_commands_repeat_only_if_they_reduce_the_flight(
    api: Api, action: str, before: ShowPhase, after: ShowPhase, again: int
) -> None:
    api.service.show = before
    answer = api("POST", f"/api/v1/show/{action}")
    assert (answer.status_code, answer.json()["outcome"]) == (202, "pending")
    assert api.service.show is after
    api.service.tick()
    assert api("GET", "/api/v1/show").json()["phase"] == after
    assert (action in api("GET", "/api/v1/show").json()["possible"]) is (again == 202)
    assert api("POST", f"/api/v1/show/{action}").status_code == again


def test_a_start_that_would_be_refused_is_not_possible(api: Api) -> None:
    """Everywhere that a client reads it, with the reason; a stopped control starts nothing either."""
    assert "start" in api("GET", "/api/v1/show").json()["possible"]
    why = "checklist pads: 2 of 2 items are open (+1)"
    api.service.start_refused = why
    api.service.tick()
    status = api("GET", "/api/v1/status").json()
    fleet = api("GET", "/api/v1/fleet").json()
    for show in (api("GET", "/api/v1/show").json(), fleet["show"], status["show"]):
        assert (show["possible"], show["start_refused"]) == ([], why)
    feed = Feed(api.service, "off", str)
    first, _ = feed.status(0.0)
    api.service.start_refused = ""
    api.service.tick()
    revision, text = feed.status(1.0)
    assert revision == first + 1
    assert '"start_refused":""' in text
    api.service.control_alive = False
    api.service.tick()
    show = api("GET", "/api/v1/show").json()
    assert show["possible"] == []
    assert show["start_refused"].startswith("control is not alive: ")


@pytest.mark.parametrize("body", [b"", b"{}", b"null"])
def test_start_without_names_takes_every_vehicle(api: Api, body: bytes) -> None:
    answer = api("POST", "/api/v1/show/start", content=body, headers={"Content-Type": "application/json"})
    assert (answer.status_code, list(answer.json()["outcomes"])) == (202, ["d1", "d2", "d3"])


def test_start_takes_the_vehicles_named(api: Api) -> None:
    answer = api("POST", "/api/v1/show/start", json={"vehicles": ["d1", "d3"]})
    assert list(answer.json()["outcomes"]) == ["d1", "d3"]


def test_start_with_an_unknown_vehicle_is_404_and_starts_nothing(api: Api) -> None:
    answer = api("POST", "/api/v1/show/start", json={"vehicles": ["d1", "d99"]})
    assert answer.status_code == 404
    assert api.service.show is ShowPhase.IDLE


def test_command_reports_its_outcome_per_vehicle(api: Api) -> None:
    command_id = api("POST", "/api/v1/show/start").json()["id"]
    api.service.finish(command_id, Outcome.FAILED, "no GPS")
    command = api("GET", f"/api/v1/commands/{command_id}").json()
    assert command["outcome"] == "failed"
    assert command["outcomes"]["d1"] == {"outcome": "failed", "reason": "no GPS"}
    assert api("GET", "/api/v1/commands/o99").status_code == 404


def test_a_change_of_the_formation_leaves_the_rest_as_it_is(api: Api) -> None:
    answer = api("PATCH", "/api/v1/formation", json={"radius_m": 12})
    assert (answer.json()["radius_m"], answer.json()["height_m"]) == (12.0, 20.0)
    assert api.service.plan.current.formation.radius_m == 12.0


def test_two_changes_within_a_tick_both_count(api: Api) -> None:
    api("PATCH", "/api/v1/formation", json={"radius_m": 12})
    api("PATCH", "/api/v1/formation", json={"height_m": 30})
    api("PATCH", "/api/v1/orbit", json={"radius_m": 40})
    assert api.service.plan.current.formation == Formation(12.0, 30.0)
    before_the_tick = api("GET", "/api/v1/formation").json()
    assert (before_the_tick["radius_m"], before_the_tick["height_m"]) == (12.0, 30.0)
    assert api("GET", "/api/v1/orbit").json()["radius_m"] == 40.0
    api.service.tick()
    assert api("GET", "/api/v1/fleet").json()["formation"]["height_m"] == 30.0


def test_a_radius_too_small_names_the_smallest_that_works(api: Api) -> None:
    answer = api("PATCH", "/api/v1/formation", json={"radius_m": 2.0})
    assert answer.status_code == 422
    assert answer.json() == {
        "detail": "radius_m = 2.0: at least 5.2 m for 3 vehicles",
        "problems": [{"field": "radius_m", "value": 2.0, "allowed": "at least 5.2 m for 3 vehicles"}],
    }
    assert api.service.plan.current.formation.radius_m == 10.0


def test_a_sphere_below_the_minimum_height_is_refused(api: Api) -> None:
    problem = api("PATCH", "/api/v1/formation", json={"height_m": 11.0}).json()["problems"][0]
    assert problem == {"field": "height_m", "value": 11.0, "allowed": "at least 12.0 m with this radius"}


def test_a_target_in_the_show_frame_is_answered_in_both_frames(api: Api) -> None:
    body = {"x_m": 100.0, "y_m": 0.0, "velocity_x_m_s": 1.0, "velocity_y_m_s": 0.0}
    answer = api("PUT", "/api/v1/target", json=body).json()
    assert (answer["x_m"], answer["y_m"]) == (100.0, 0.0)
    assert answer["longitude_deg"] > 8.5456  # x is east with this show's heading
    assert answer["latitude_deg"] == pytest.approx(47.3977, abs=1e-5)
    assert answer["velocity_east_m_s"] == pytest.approx(1.0)
    assert answer["velocity_north_m_s"] == pytest.approx(0.0)


def test_target_by_latitude_equals_the_target_in_the_frame(api: Api) -> None:
    reported = api("PUT", "/api/v1/target", json={"x_m": 100.0, "y_m": -40.0, "velocity_y_m_s": 2.0}).json()
    geodetic = {
        name: value for name, value in reported.items() if not name.startswith(("x_", "y_", "velocity_"))
    }
    again = api("PUT", "/api/v1/target", json={**geodetic, "velocity_north_m_s": -2.0}).json()
    assert (again["x_m"], again["y_m"]) == (pytest.approx(100.0, abs=1e-3), pytest.approx(-40.0, abs=1e-3))
    assert again["velocity_y_m_s"] == pytest.approx(2.0)


def test_clearance_of_a_target_is_kept_in_both_frames(api: Api) -> None:
    kept = {"height_m": 4.0, "clearance_m": 12.0}
    reported = api("PUT", "/api/v1/target", json={"x_m": 9.0, "y_m": 0.0, **kept}).json()
    assert kept.items() <= reported.items()
    globe = {name: reported[name] for name in ("latitude_deg", "longitude_deg")}
    assert kept.items() <= api("PUT", "/api/v1/target", json={**globe, **kept}).json().items()
    assert api("PUT", "/api/v1/target", json=globe).json()["clearance_m"] == 0.0
    assert "one frame" in api("PUT", "/api/v1/target", json=kept).json()["detail"]


def test_moving_target_continues(api: Api) -> None:
    api("PUT", "/api/v1/target", json={"x_m": 0.0, "y_m": 0.0, "velocity_x_m_s": 900.0})
    first = api("GET", "/api/v1/target").json()["x_m"]
    assert 0.0 < first < api("GET", "/api/v1/target").json()["x_m"]


def test_the_orbit_is_changed_field_by_field(api: Api) -> None:
    api("PATCH", "/api/v1/orbit", json={"radius_m": 0, "direction": "clockwise"})
    answer = api("PATCH", "/api/v1/orbit", json={"speed_m_s": 3.5})
    assert answer.json() == {"radius_m": 0.0, "speed_m_s": 3.5, "direction": "clockwise"}
    assert api.service.plan.current.orbit.direction is Direction.CLOCKWISE


def test_the_heading_is_turned_into_the_show_frame_and_back(api: Api) -> None:
    answer = api("PATCH", "/api/v1/yaw", json={"policy": "fixed", "heading_deg": 0.0})
    assert answer.json() == {"policy": "fixed", "heading_deg": pytest.approx(0.0)}
    assert api.service.plan.current.yaw.policy is YawPolicy.FIXED
    assert api.service.plan.current.yaw.fixed_rad == pytest.approx(-math.pi / 2)
    assert api("PATCH", "/api/v1/yaw", json={"policy": "target"}).json()["policy"] == "target"
    assert api("GET", "/api/v1/yaw").json()["heading_deg"] == pytest.approx(0.0)


def test_an_obstacle_is_added_read_changed_and_removed(api: Api) -> None:
    added = api("POST", "/api/v1/obstacles", json={"id": "tower", **BOX})
    standing = {"velocity_x_m_s": 0.0, "velocity_y_m_s": 0.0}
    assert (added.status_code, added.json()) == (201, {"id": "tower", **BOX, **standing})
    assert added.headers["location"] == "/api/v1/obstacles/tower"
    changed = api("PUT", "/api/v1/obstacles/tower", json={**BOX, "height_m": 9.0})
    assert changed.json()["height_m"] == 9.0
    assert api("GET", "/api/v1/obstacles/tower").json()["height_m"] == 9.0
    assert [box.height_m for box in api.service.plan.current.obstacles] == [9.0]
    removed = api("DELETE", "/api/v1/obstacles/tower")
    assert (removed.status_code, removed.content) == (204, b"")
    assert api("GET", "/api/v1/obstacles").json() == []
    for method, body in (("GET", None), ("PUT", BOX), ("DELETE", None)):
        assert api(method, "/api/v1/obstacles/tower", json=body).status_code == 404


def test_an_obstacle_that_moves_is_reported_where_it_is_now(api: Api) -> None:
    moving = {**BOX, "id": "crane", "velocity_x_m_s": 1.0, "velocity_y_m_s": -0.5}
    assert api("POST", "/api/v1/obstacles", json=moving).json()["x_m"] == pytest.approx(BOX["x_m"], abs=0.5)
    box = api.service.plan.current.obstacles[0]
    assert (box.velocity_x_m_s, box.velocity_y_m_s) == (1.0, -0.5)
    reported = convert.obstacle(box, box.time_s + 4.0)
    assert (reported.x_m, reported.y_m) == pytest.approx((box.x_m + 4.0, box.y_m - 2.0))


def test_obstacle_without_an_id_gets_one_never_used(api: Api) -> None:
    api("POST", "/api/v1/obstacles", json={"id": "box-2", **BOX})
    ids = [api("POST", "/api/v1/obstacles", json=BOX).json()["id"] for _ in range(2)]
    assert ids == ["box-1", "box-3"]
    api("DELETE", "/api/v1/obstacles/box-3")
    assert api("POST", "/api/v1/obstacles", json=BOX).json()["id"] == "box-4"


def test_an_obstacle_whose_id_is_taken_is_refused(api: Api) -> None:
    api.service.fly()
    assert api("POST", "/api/v1/obstacles", json={**BOX, "id": "once"}).status_code == 201
    twice = api("POST", "/api/v1/obstacles", json={**BOX, "id": "once"})
    assert (twice.status_code, "already" in twice.json()["detail"]) == (409, True)


def test_an_obstacle_cannot_be_renamed_by_changing_it(api: Api) -> None:
    api("POST", "/api/v1/obstacles", json={"id": "tower", **BOX})
    assert api("PUT", "/api/v1/obstacles/tower", json={"id": "tower", **BOX}).status_code == 200
    answer = api("PUT", "/api/v1/obstacles/tower", json={"id": "other", **BOX})
    assert answer.json()["problems"] == [
        {"field": "id", "value": "other", "allowed": "'tower', as in the path, or absent"}
    ]


def test_the_law_is_chosen_by_name(api: Api) -> None:
    assert api("GET", "/api/v1/formation").json()["law"] == "slots"
    assert api("PATCH", "/api/v1/formation", json={"law": "article"}).json()["law"] == "article"
    assert api.service.plan.current.formation == Formation(10.0, 20.0, law="article")
    answer = api("PATCH", "/api/v1/formation", json={"law": "gravity"})
    assert answer.status_code == 422
    assert "one of slots, article, neighbours" in answer.json()["problems"][0]["allowed"]


def test_corrections_report_their_age_and_base() -> None:
    service = FakeService()
    api = Api(service)
    assert api("GET", "/api/v1/features").json()["corrections"] is None
    corrections = CorrectionsView(
        "ntrip://192.0.2.7:2101/BASE",
        0.4,
        "",
        47.4,
        8.5,
        math.nan,
        messages=9,
        received_bytes=900,
        sent=18,
        dropped=1,
    )
    service.features = Features(corrections=corrections)
    service.tick()
    found = api("GET", "/api/v1/features").json()["corrections"]
    assert (found["age_s"], found["messages"], found["base_latitude_deg"]) == (0.4, 9, 47.4)
    assert found["base_height_m"] is None
    for path in ("fleet", "status"):
        assert api("GET", f"/api/v1/{path}").json()["features"]["corrections"] == found


def test_lights_report_their_driver_and_counts() -> None:
    api = Api(FakeService())
    assert api("GET", "/api/v1/fleet").json()["features"]["lights"] == {
        "driver": "led-control",
        "sent": 120,
        "dropped": 30,
    }
    assert api("GET", "/api/v1/status").json()["features"]["lights"]["driver"] == "led-control"
