import json
from pathlib import Path
from typing import Any

import pytest

from gcs.api.app import create_app
from gcs.api.auth.authorization import Authorization
from gcs.api.auth.tokens import Tokens, create_token
from gcs.api.openapi import MEANING
from gcs.model.vehicle_columns import FRAME, SHARE
from gcs.service.access import Role
from tests.support.api_fake_service import FakeService
from tests.support.api_harness import Api


@pytest.fixture(scope="module")
def document() -> Any:
    return Api()("GET", "/openapi.json").json()


@pytest.fixture(scope="module")
def operations(document: Any) -> dict[str, Any]:
    return {
        f"{method} {path}": operation
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
    }


def test_every_operation_has_its_own_name_a_summary_and_a_tag(operations: dict[str, Any]) -> None:
    names = [operation["operationId"] for operation in operations.values()]
    assert len(names) == len(set(names)) == 88
    assert all(name.isidentifier() for name in names)
    assert all(operation["summary"] and operation["description"] for operation in operations.values())
    assert all(len(operation["tags"]) == 1 for operation in operations.values())


def test_every_documented_error_has_the_one_shape(document: Any, operations: dict[str, Any]) -> None:
    errors = [
        (name, status, answer)
        for name, operation in operations.items()
        for status, answer in operation["responses"].items()
        if int(status) >= 400
    ]
    assert len(errors) > 100
    shared = document["components"]["responses"]
    for name, status, answer in errors:
        assert answer == {"$ref": f"#/components/responses/Error{status}"}, name
        assert shared[f"Error{status}"]["description"] == MEANING[int(status)]
        schema = shared[f"Error{status}"]["content"]["application/json"]["schema"]
        assert schema == {"$ref": "#/components/schemas/ErrorBody"}, name


def test_every_command_documents_what_it_may_answer(operations: dict[str, Any]) -> None:
    for name, operation in operations.items():
        documented = set(operation["responses"])
        assert documented >= {"401", "403", "429", "500", "503"}, name
        if not name.startswith("get"):
            assert documented >= {"400", "409", "413", "415", "422"}, name
        if "{" in name and name != "put /api/v1/shows/{name}":  # what is not there, it makes
            assert documented >= {"404", "422"}, name
    assert "202" in operations["post /api/v1/show/start"]["responses"]
    assert "201" in operations["post /api/v1/obstacles"]["responses"]
    assert "503" in operations["get /healthz"]["responses"]


def test_every_reference_resolves_and_no_placeholder_leaks(document: Any) -> None:
    text = json.dumps(document)
    schemas = document["components"]["schemas"]
    used = {part.split('"')[0] for part in text.split('"#/components/schemas/')[1:]}
    assert used <= set(schemas)
    assert "HTTPValidationError" not in schemas
    assert '"default": null' not in text
    assert schemas["FormationChange"]["properties"]["radius_m"]["exclusiveMinimum"] == 0
    assert "required" not in schemas["FormationChange"]
    assert schemas["FormationChange"]["additionalProperties"] is False


def test_every_number_names_its_unit(document: Any) -> None:
    units = ("_m", "_s", "_m_s", "_deg", "_hz", "_ms", "_j")
    without = {
        field
        for schema in document["components"]["schemas"].values()
        for field, described in schema.get("properties", {}).items()
        if "number" in json.dumps(described) and not field.endswith(units)
    }
    # shares of 1, what was wrong, of a replay, of a timecode's rate, and how many tracks
    assert without == {
        *(name for name, column in FRAME.items() if column.unit == SHARE),
        "battery_least",
        "battery_median",
        "battery_need",
        "value",
        "speed",
        "limit",
        "tolerated",
        "worst",
        "floor_ratio",
        "floor_ratio_if_off",
        "slope",
        "tempo",
        *("known", "near", "manned", "vehicles", "verified", "area_count", "ready"),
        *("items", "kp"),  # numbers of items, and an index
    }


def test_a_token_is_demanded_only_where_one_is(document: Any, tmp_path: Path) -> None:
    """Without access control the document has no security at all; with tokens only the probes are free."""
    assert "security" not in json.dumps(document)
    file = tmp_path / "tokens.json"
    create_token(file, "crew", Role.WATCH)
    guarded = create_app(FakeService(), authorization=Authorization(Tokens(file))).openapi()
    free = {
        path
        for path, methods in guarded["paths"].items()
        for operation in methods.values()
        if not operation.get("security")
    }
    assert free == {"/healthz", "/readyz"}
    assert set(guarded["components"]["securitySchemes"]) == {"HTTPBearer"}


def test_document_names_the_server_and_the_longest_name(document: Any) -> None:
    assert [server["url"] for server in document["servers"]] == ["/"]
    asked = [
        parameter
        for methods in document["paths"].values()
        for operation in methods.values()
        for parameter in operation.get("parameters", [])
        if parameter["in"] == "path"
    ]
    assert len(asked) > 10
    assert all({"maxLength", "pattern", "enum", "type"} & set(each["schema"]) > {"type"} for each in asked)
    start = document["components"]["schemas"]["StartBody"]["properties"]["vehicles"]
    assert start["items"]["maxLength"] == 64
