"""Every key of a configuration says what it means: docs/reference/configuration.md has nothing else."""

from typing import Any, Final

import pytest

from gcs.config.schema import Config

SCHEMA: Final[dict[str, Any]] = Config.model_json_schema()
SECTIONS: Final[dict[str, dict[str, Any]]] = {"Config": SCHEMA, **SCHEMA["$defs"]}


@pytest.mark.parametrize("section", SECTIONS)
def test_every_section_and_key_has_a_meaning(section: str) -> None:
    definition = SECTIONS[section]
    keys = definition.get("properties", {})
    assert definition["description"].strip()
    assert [key for key, field in keys.items() if not field.get("description", "").strip()] == []


def test_all_sections_of_a_file_are_judged() -> None:
    assert len(SECTIONS) > 40
    assert sum(len(each.get("properties", {})) for each in SECTIONS.values()) > 280
