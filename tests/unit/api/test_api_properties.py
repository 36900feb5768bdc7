import json
from typing import Any
from urllib.parse import quote

from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.api.schemas import requests
from tests.support.api_harness import Api

NAMES = st.sampled_from(
    sorted(
        {
            *requests.FormationChange.model_fields,
            *requests.OrbitChange.model_fields,
            *requests.YawChange.model_fields,
            *requests.ShowTarget.model_fields,
            *requests.GeodeticTarget.model_fields,
            *requests.ObstaclePost.model_fields,
            *requests.StartBody.model_fields,
            *requests.ChecklistItems.model_fields,
            *requests.Weather.model_fields,
            "hash",
            "cue",
            "\ud800",
        }
    )
)
NUMBERS = st.floats() | st.floats(-200, 200) | st.integers() | st.integers(-(10**400), 10**400)
VALUES = st.recursive(
    NUMBERS
    | st.none()
    | st.booleans()
    | st.text(max_size=5)
    | st.sampled_from(["d1", "clockwise", "fixed", "\ud800", "-0", "1e5"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=5,
)
PROPER = [
    {"radius_m": 20.0, "height_m": 40.0},
    {"x_m": 1.0, "y_m": 2.0, "velocity_x_m_s": 1.0},
    {"latitude_deg": 47.4, "longitude_deg": 8.5},
    {"x_m": 30.0, "y_m": 0.0, "half_length_x_m": 1.0, "half_length_y_m": 1.0, "height_m": 5.0},
    {"role": "pads", "items": [1]},
    {"wind_m_s": 4.0, "kp": 2.0},
    {"hash": "3f2a9c01b4de"},
]
OBJECTS = st.builds(
    lambda base, more: {**base, **more},
    st.sampled_from([{}, *PROPER]),
    st.dictionaries(NAMES, VALUES, max_size=2),
)
BODIES = OBJECTS.map(json.dumps) | VALUES.map(json.dumps) | st.text(max_size=20)

ENDPOINTS = st.sampled_from(
    [
        ("PATCH", "/formation"),
        ("PATCH", "/orbit"),
        ("PATCH", "/yaw"),
        ("PUT", "/target"),
        ("POST", "/obstacles"),
        ("PUT", "/obstacles/box-1"),
        ("POST", "/show/start"),
        ("POST", "/show/stop"),
        ("POST", "/show/seek"),
        ("POST", "/shows/lighthouse/select"),
        ("PUT", "/shows/lighthouse"),
        ("DELETE", "/shows/lighthouse"),
        ("POST", "/go/sign"),
        ("POST", "/go/reopen"),
        ("PUT", "/go/weather"),
        ("POST", "/show/confirm"),
        ("POST", "/kill"),
        ("POST", "/kill/confirm"),
        ("POST", "/vehicles/d1/land"),
    ]
)


API = Api()  # made once: most of an example's time would go into it


def fresh() -> Api:
    API.service.reset()
    return API


def refuse_constant(name: str) -> Any:
    raise AssertionError(f"{name} in an answer")


def everything(api: Api) -> tuple[Any, ...]:
    """All that a request may change."""
    service = api.service
    plan, commands = service.plan.current, service.command_log.newest()
    return plan, service.show, dict(service.phases), commands, service.checklists.view(), service.weather


@settings(max_examples=3 * settings().max_examples)
@given(endpoint=ENDPOINTS, text=BODIES, flying=st.booleans())
def test_no_body_makes_a_5xx_and_nothing_changes_unless_accepted(
    endpoint: tuple[str, str], text: str, flying: bool
) -> None:
    method, path = endpoint
    api = fresh()
    if flying:
        api.service.fly()
    before = everything(api)
    body = text.encode("utf-8", errors="surrogatepass")
    answer = api(method, f"/api/v1{path}", content=body, headers={"Content-Type": "application/json"})
    assert answer.status_code in (200, 201, 202, 400, 404, 409, 422)
    shown = json.loads(answer.text, parse_constant=refuse_constant)
    if answer.status_code >= 400:
        assert set(shown) == {"detail", "problems"}
        assert everything(api) == before
    else:
        assert everything(api) != before or method in ("PATCH", "PUT") or path in {"/kill", "/go/reopen"}


SEGMENTS = st.text(st.characters(codec="utf-8", exclude_characters="/?#\\"), max_size=12)


@given(
    method=st.sampled_from(["GET", "POST", "PUT", "PATCH", "DELETE"]),
    parts=st.lists(
        st.sampled_from(["vehicles", "obstacles", "commands", "d1", "kill"]) | SEGMENTS, max_size=4
    ),
)
def test_no_path_makes_a_5xx(method: str, parts: list[str]) -> None:
    api = fresh()
    before = everything(api)
    answer = api(method, "/".join(["/api/v1", *(quote(part, safe="") for part in parts)]))
    assert answer.status_code < 500
    if answer.status_code >= 400:
        assert set(answer.json()) == {"detail", "problems"}
        assert everything(api) == before
