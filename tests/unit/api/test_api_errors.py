import gzip
import json
from typing import Any

import httpx
import pytest

from gcs.api.schemas import reports
from gcs.model.errors import LinkError, ShapeError
from gcs.model.lifecycle import ShowPhase
from gcs.service import CommandRecord, ShowAction
from tests.support.api_fake_service import FakeService
from tests.support.api_harness import Api

JSON = {"Content-Type": "application/json"}
BOX = {"x_m": 50.0, "y_m": 0.0, "half_length_x_m": 2.0, "half_length_y_m": 3.0, "height_m": 15.0}
SHOW_TARGET = {"x_m": 1.0, "y_m": 2.0}
GLOBE_TARGET = {"latitude_deg": 47.3977, "longitude_deg": 8.5456}


@pytest.fixture(scope="module")
def made_once() -> Api:
    return Api()


@pytest.fixture
def api(made_once: Api) -> Api:
    made_once.service.reset()
    return made_once


def problems(answer: httpx.Response) -> list[reports.FieldProblem]:
    """The problems of a 422, whose body must have the one shape and be JSON without NaN."""
    assert answer.status_code == 422, answer.text
    body = reports.ErrorBody.model_validate(json.loads(answer.text, parse_constant=pytest.fail))
    assert set(answer.json()) == {"detail", "problems"}
    assert all(problem.field in body.detail for problem in body.problems)
    return body.problems


def raw(api: Api, method: str, path: str, text: str) -> httpx.Response:
    return api(method, f"/api/v1{path}", content=text.encode(), headers=JSON)


BAD_VALUES: list[tuple[str, Any, str]] = [
    ("NaN", "NaN", "a finite number"),
    ("Infinity", "Infinity", "a finite number"),
    ("-Infinity", "-Infinity", "a finite number"),
    ("1e999", "Infinity", "a finite number"),
    ('"12"', "12", "a valid number"),
    ("null", None, "a valid number"),
    ("true", True, "a valid number"),
    ('{"nested": ["garbage"]}', '{"nested": ["garbage"]}', "a valid number"),
    ("[]", "[]", "a valid number"),
    ("-1e300", -1e300, "greater than"),
    ("1e300", 1e300, "less than or equal to"),
]

NUMBERS: list[tuple[str, str, str, dict[str, Any]]] = [
    ("PATCH", "/formation", "radius_m", {}),
    ("PATCH", "/formation", "height_m", {}),
    ("PATCH", "/orbit", "radius_m", {}),
    ("PATCH", "/orbit", "speed_m_s", {}),
    ("PATCH", "/yaw", "heading_deg", {}),
    ("PUT", "/target", "x_m", SHOW_TARGET),
    ("PUT", "/target", "y_m", SHOW_TARGET),
    ("PUT", "/target", "velocity_x_m_s", SHOW_TARGET),
    ("PUT", "/target", "height_m", SHOW_TARGET),
    ("PUT", "/target", "clearance_m", GLOBE_TARGET),
    ("PUT", "/target", "latitude_deg", GLOBE_TARGET),
    ("PUT", "/target", "longitude_deg", GLOBE_TARGET),
    ("PUT", "/target", "velocity_east_m_s", GLOBE_TARGET),
    *(("POST", "/obstacles", field, BOX) for field in BOX),
    *(("PUT", "/obstacles/tower", field, BOX) for field in BOX),
]


@pytest.mark.parametrize("bad", BAD_VALUES, ids=lambda bad: str(bad[0]))
@pytest.mark.parametrize("place", NUMBERS, ids=lambda place: f"{place[1]}:{place[2]}")
def test_bad_number_is_422_with_field_value_and_allowed_range(
    api: Api, place: tuple[str, str, str, dict[str, Any]], bad: tuple[str, Any, str]
) -> None:
    method, path, field, rest = place
    text, value, allowed = bad
    plan = api.service.plan.current
    others = "".join(f', "{name}": {other}' for name, other in rest.items() if name != field)
    (problem,) = problems(raw(api, method, path, f'{{"{field}": {text}{others}}}'))
    assert (problem.field, problem.value) == (field, value)
    assert problem.allowed.startswith(allowed)
    assert api.service.plan.current is plan


@pytest.mark.parametrize(
    ("method", "path", "body", "field"),
    [
        ("PATCH", "/formation", {"radius_m": 0}, "radius_m"),
        ("PATCH", "/formation", {"radius_m": -4}, "radius_m"),
        ("PATCH", "/orbit", {"radius_m": -0.1}, "radius_m"),
        ("PATCH", "/orbit", {"speed_m_s": 0}, "speed_m_s"),
        ("PATCH", "/orbit", {"direction": "left"}, "direction"),
        ("PATCH", "/orbit", {"direction": 1}, "direction"),
        ("PATCH", "/orbit", {"direction": None}, "direction"),
        ("PATCH", "/yaw", {"policy": "sideways"}, "policy"),
        ("PUT", "/target", {**GLOBE_TARGET, "latitude_deg": 90.1}, "latitude_deg"),
        ("PUT", "/target", {**GLOBE_TARGET, "clearance_m": -1}, "clearance_m"),
        ("PUT", "/target", {**GLOBE_TARGET, "longitude_deg": -181}, "longitude_deg"),
        ("POST", "/obstacles", {**BOX, "half_length_x_m": 0}, "half_length_x_m"),
        ("POST", "/obstacles", {**BOX, "id": "a/b"}, "id"),
        ("POST", "/obstacles", {**BOX, "id": ""}, "id"),
        ("POST", "/obstacles", {**BOX, "id": "x" * 65}, "id"),
        ("POST", "/obstacles", {**BOX, "id": 7}, "id"),
        ("POST", "/obstacles", {**BOX, "id": "\ud800"}, "id"),
        ("POST", "/show/start", {"vehicles": []}, "vehicles"),
        ("POST", "/show/start", {"vehicles": "d1"}, "vehicles"),
        ("POST", "/show/start", {"vehicles": [1]}, "vehicles.0"),
        ("POST", "/show/start", {"vehicles": None}, "vehicles"),
        ("POST", "/show/stop", {"vehicles": ["d1"]}, "body"),
        ("POST", "/vehicles/d1/land", {"sure": True}, "body"),
        ("POST", "/kill", {"sure": True}, "sure"),
        ("POST", "/kill", {"vehicles": []}, "vehicles"),
        ("POST", "/kill", {"vehicles": None}, "vehicles"),
        ("POST", "/kill/confirm", {}, "code"),
        ("POST", "/kill/confirm", {"code": "yes"}, "code"),
    ],
)
def test_a_value_out_of_range_names_its_field(
    api: Api, method: str, path: str, body: dict[str, Any], field: str
) -> None:
    (problem,) = problems(raw(api, method, path, json.dumps(body)))
    assert problem.field == field


@pytest.mark.parametrize(("method", "path"), [("POST", "/obstacles"), ("PUT", "/obstacles/tower")])
@pytest.mark.parametrize("field", BOX)
def test_a_missing_field_is_required(api: Api, method: str, path: str, field: str) -> None:
    body = {name: value for name, value in BOX.items() if name != field}
    (problem,) = problems(api(method, f"/api/v1{path}", json=body))
    assert (problem.field, problem.value, problem.allowed) == (field, None, "required")


def test_several_problems_are_reported_at_once(api: Api) -> None:
    answer = api("POST", "/api/v1/obstacles", json={**BOX, "x_m": "here", "y_m": "there"})
    assert [problem.field for problem in problems(answer)] == ["x_m", "y_m"]


@pytest.mark.parametrize(
    ("method", "path", "body"),
    [
        ("PATCH", "/formation", {"radius_m": 12, "radius": 13}),
        ("PATCH", "/orbit", {"radius_m": 12, "radius": 13}),
        ("PATCH", "/yaw", {"policy": "held", "radius": 13}),
        ("PUT", "/target", {**SHOW_TARGET, "radius": 13}),
        ("PUT", "/target", {**GLOBE_TARGET, "radius": 13}),
        ("POST", "/obstacles", {**BOX, "radius": 13}),
        ("PUT", "/obstacles/tower", {**BOX, "radius": 13}),
        ("POST", "/show/start", {"radius": 13}),
    ],
)
def test_an_unknown_field_is_refused(api: Api, method: str, path: str, body: dict[str, Any]) -> None:
    (problem,) = problems(api(method, f"/api/v1{path}", json=body))
    assert (problem.field, problem.value, problem.allowed) == ("radius", 13, "not a field of this request")


@pytest.mark.parametrize("path", ["/formation", "/orbit", "/yaw"])
def test_a_change_of_nothing_is_refused(api: Api, path: str) -> None:
    (problem,) = problems(api("PATCH", f"/api/v1{path}", json={}))
    assert (problem.field, problem.allowed) == ("body", "at least one field")


@pytest.mark.parametrize("body", [SHOW_TARGET | GLOBE_TARGET, {}, {"velocity_x_m_s": 1.0, **GLOBE_TARGET}])
def test_a_target_in_two_frames_or_none_is_refused_clearly(api: Api, body: dict[str, Any]) -> None:
    (problem,) = problems(api("PUT", "/api/v1/target", json=body))
    assert problem.field == "body"
    assert problem.allowed.endswith("one frame, not both")


def test_a_target_on_the_other_side_of_the_globe_is_refused(api: Api) -> None:
    body = {"latitude_deg": -47.0, "longitude_deg": -171.0}
    (problem,) = problems(api("PUT", "/api/v1/target", json=body))
    assert problem.field == "latitude_deg, longitude_deg"
    assert problem.allowed == "within 100 km of the show's origin"


WITH_BODY = [
    ("PATCH", "/formation"),
    ("PATCH", "/orbit"),
    ("PATCH", "/yaw"),
    ("PUT", "/target"),
    ("POST", "/obstacles"),
    ("PUT", "/obstacles/tower"),
    ("POST", "/show/start"),
]


@pytest.mark.parametrize(("method", "path"), WITH_BODY)
@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("{", "body"),
        ('{"radius_m": }', "body"),
        ("\x00", "body"),
        ("[1, 2]", "body"),
        ('"text"', "body"),
        ("7", "body"),
        ("NaN", "body"),
        ('{"radius_m": ' + "9" * 5000 + "}", "radius_m"),
        ('{"box": {"sides": [1, ' + "9" * 60_000 + "]}}", "box.sides.1"),
        ("[" * 60_000, "body"),
        ('{"a":' * 10_000 + "1" + "}" * 10_000, "body"),
        ("[]," * 20_000, "body"),
    ],
    ids=lambda text: str(text)[:16],
)
def test_a_malformed_body_is_422_with_the_field(
    api: Api, method: str, path: str, text: str, field: str
) -> None:
    (problem,) = problems(raw(api, method, path, text))
    assert problem.field == field
    assert len(str(problem.value)) <= 80


@pytest.mark.parametrize(
    ("method", "path", "body", "field", "value"),
    [
        ("PATCH", "/formation", '{"radius_m": 12, "radius_m": 40}', "radius_m", 40),
        ("PUT", "/target", '{"x_m": 1, "y_m": 2, "x_m": 1}', "x_m", 1),
        ("POST", "/show/start", '{"vehicles": ["d1"], "vehicles": ["d2"]}', "vehicles", '["d2"]'),
        ("POST", "/kill", '{"vehicles": ["d1"], "vehicles": ["d2"]}', "vehicles", '["d2"]'),
        ("PATCH", "/yaw", '{"policy": {"a": 1, "b": {"c": 1, "c": true}}}', "policy.b.c", True),
    ],
)
def test_a_name_given_twice_is_refused_and_nothing_changes(
    api: Api, method: str, path: str, body: str, field: str, value: Any
) -> None:
    plan = api.service.plan.current
    (problem,) = problems(raw(api, method, path, body))
    assert (problem.field, problem.value, problem.allowed) == (field, value, "given once, not twice")
    assert api.service.plan.current is plan
    assert api.service.show is ShowPhase.IDLE


@pytest.mark.parametrize("coding", ["gzip", "br", "deflate, gzip", "x" * 500])
def test_a_compressed_body_is_refused(api: Api, coding: str) -> None:
    headers = {**JSON, "Content-Encoding": coding}
    answer = api("PATCH", "/api/v1/formation", content=gzip.compress(b'{"radius_m": 12}'), headers=headers)
    assert answer.status_code == 415
    body = reports.ErrorBody.model_validate(answer.json())
    assert body.detail.startswith(f"Content-Encoding: {coding[:70]}")
    assert len(body.detail) < 200


@pytest.mark.parametrize(
    ("method", "path", "body"),
    [
        ("PATCH", "/formation", '{"radius_m": null}'),
        ("PATCH", "/formation", '{"radius_m": true}'),
        ("PATCH", "/formation", '{"radius_m": {"a": null, "b": [true, false]}}'),
        ("PATCH", "/formation", "[null, true]"),
        ("POST", "/obstacles", "{}"),
        ("POST", "/show/start", '{"vehicles": [null]}'),
        ("POST", "/show/start", '{"vehicles": {"d1": false}}'),
        ("POST", "/show/stop", '{"why": null}'),
    ],
)
def test_no_python_text_in_answers(api: Api, method: str, path: str, body: str) -> None:
    answer = raw(api, method, path, body)
    problems(answer)
    for word in ("None", "True", "False", "dict", "tuple", "b'", "{'"):
        assert word not in answer.text


def test_body_of_another_type_is_echoed_as_text(api: Api) -> None:
    answer = api(
        "PATCH", "/api/v1/formation", content=b'{"radius_m": 12}', headers={"Content-Type": "text/plain"}
    )
    (problem,) = problems(answer)
    assert problem.value == '{"radius_m": 12}'


@pytest.mark.parametrize(("method", "path"), [each for each in WITH_BODY if each[1] != "/show/start"])
def test_an_empty_body_is_refused(api: Api, method: str, path: str) -> None:
    (problem,) = problems(raw(api, method, path, ""))
    assert (problem.field, problem.allowed) == ("body", "a JSON object, which is required")


@pytest.mark.parametrize(("method", "path"), WITH_BODY)
@pytest.mark.parametrize("kind", ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data"])
def test_another_content_type_is_refused(api: Api, method: str, path: str, kind: str) -> None:
    body = json.dumps(BOX).encode()
    (problem,) = problems(api(method, f"/api/v1{path}", content=body, headers={"Content-Type": kind}))
    assert (problem.field, problem.allowed) == (
        "body",
        "a JSON object, sent as Content-Type: application/json",
    )


def test_bytes_that_are_not_utf_8_are_refused(api: Api) -> None:
    answer = api("PATCH", "/api/v1/formation", content=b'{"\xff\xfe": 1}', headers=JSON)
    (problem,) = problems(answer)
    assert (problem.field, problem.allowed) == ("body", "JSON in UTF-8; byte 2 is not")


def test_a_long_wrong_value_is_echoed_short(api: Api) -> None:
    (problem,) = problems(raw(api, "PATCH", "/formation", json.dumps({"radius_m": "x" * 50_000})))
    assert len(str(problem.value)) == 80  # as in every message of ours
    (problem,) = problems(raw(api, "PATCH", "/formation", json.dumps({"y" * 50_000: 1})))
    assert len(problem.field) == 80


def test_integer_too_large_for_json_is_echoed_as_text(api: Api) -> None:
    (problem,) = problems(raw(api, "PATCH", "/orbit", f'{{"radius_m": {10**20}}}'))
    assert problem.value == str(10**20)


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/nowhere", 404),
        ("GET", "/api/v1/nothing", 404),
        ("GET", "/api/v1/fleet/", 404),
        ("GET", "/api/v2/fleet", 404),
        ("POST", "/api/v1/vehicles/d1/dance", 404),
        ("POST", "/api/v1/show/dance", 404),
        ("DELETE", "/api/v1/fleet", 405),
        ("GET", "/api/v1/show/start", 405),
        ("PUT", "/api/v1/formation", 405),
        ("POST", "/healthz", 405),
    ],
)
def test_an_unknown_path_or_method_has_the_same_error_shape(
    api: Api, method: str, path: str, status: int
) -> None:
    answer = api(method, path)
    assert answer.status_code == status
    assert reports.ErrorBody.model_validate(answer.json()).problems == []
    assert path in answer.json()["detail"]
    assert ("allow" in answer.headers) == (status == 405)
    assert answer.headers.get("allow", "GET") != ""


@pytest.mark.parametrize(
    ("path", "allow"),
    [
        ("/", "GET, HEAD, OPTIONS"),
        ("/healthz", "GET, HEAD, OPTIONS"),
        ("/openapi.json", "GET, HEAD, OPTIONS"),
        ("/docs", "GET, HEAD, OPTIONS"),
        ("/metrics", "GET, HEAD, OPTIONS"),
        ("/api/v1/fleet", "GET, HEAD, OPTIONS"),
        ("/api/v1/formation", "GET, HEAD, OPTIONS, PATCH"),
        ("/api/v1/show/start", "OPTIONS, POST"),
        ("/api/v1/obstacles", "GET, HEAD, OPTIONS, POST"),
        ("/api/v1/obstacles/tower", "DELETE, GET, HEAD, OPTIONS, PUT"),
    ],
)
def test_every_path_names_its_methods_for_head_and_options(api: Api, path: str, allow: str) -> None:
    options = api("OPTIONS", path)
    assert (options.status_code, options.headers["allow"], options.content) == (204, allow, b"")
    refused = api("DELETE" if "DELETE" not in allow else "POST", path)
    assert (refused.status_code, refused.headers["allow"]) == (405, allow)
    assert allow in refused.json()["detail"]
    head, get = api("HEAD", path), api("GET", path)
    if "GET" in allow:
        assert (head.status_code, head.content) == (get.status_code, b"")
        assert head.headers["content-type"] == get.headers["content-type"]
    else:
        assert (head.status_code, head.headers["allow"]) == (405, allow)


def test_options_of_no_path_is_404(api: Api) -> None:
    assert api("OPTIONS", "/api/v1/nothing").status_code == 404


def test_a_long_path_is_cut_in_messages(api: Api) -> None:
    answer = api("GET", "/api/v1/" + "x" * 5000)
    assert answer.status_code == 404
    assert len(answer.text) < 300
    (problem,) = problems(api("GET", "/api/v1/vehicles/" + "x" * 5000))
    assert (problem.field, len(str(problem.value))) == ("vehicle_id", 80)


class BrokenService(FakeService):
    """Raises what no request should be able to cause, and what a lost transport causes."""

    def command_show(self, action: ShowAction, vehicles: object = None, **_: object) -> CommandRecord:
        if action is ShowAction.STOP:
            raise LinkError("control does not answer")
        if action is ShowAction.PAUSE:
            raise ShapeError("(3, 2) where (3, 3) is needed")
        raise ZeroDivisionError


@pytest.mark.parametrize(("action", "status"), [("stop", 503), ("pause", 500), ("resume", 500)])
def test_a_bug_is_a_500_in_the_same_shape_without_its_details(action: str, status: int) -> None:
    answer = Api(BrokenService())("POST", f"/api/v1/show/{action}")
    assert answer.status_code == status
    assert reports.ErrorBody.model_validate(answer.json()).problems == []
    assert "(3, 2)" not in answer.text
