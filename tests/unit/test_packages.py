"""gcs holds packages only, each with the sentence that docs/architecture.md repeats."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CLASS = re.compile(r"^ *class (\w+)[:(\[]", re.MULTILINE)
PACKAGES = sorted(
    path.parent
    for top in ("api", "gcs", "sim")
    for path in (ROOT / top).rglob("__init__.py")
    if path.parent != ROOT / "gcs" and not {"console", "node_modules"} & set(path.parts)
    if not any(parent.is_symlink() for parent in path.parents)
)


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_architecture_repeats_the_package_sentence(package: Path) -> None:
    docstring = ast.get_docstring(ast.parse((package / "__init__.py").read_text(encoding="utf-8")))
    assert docstring is not None
    sentence = docstring.partition("\n")[0]
    row = f"| `{package.relative_to(ROOT)}/` | {sentence} |"
    assert row in (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8").splitlines()


def test_no_module_lies_flat_in_gcs() -> None:
    assert {path.name for path in (ROOT / "gcs").glob("*.py")} == {"__init__.py", "__main__.py"}


def test_at_most_twenty_three_packages() -> None:
    """The twenty-third are the areas of a site, which configuration, shows and planning ask alike."""
    assert len([path for path in PACKAGES if path.parent.name == "gcs"]) <= 23


def test_no_two_classes_of_gcs_share_a_name() -> None:
    """The API's schemas and the fake vehicles have worlds of their own: `api/` and `sim/` do not count."""
    modules: dict[str, list[str]] = {}
    for path in (ROOT / "gcs").rglob("*.py"):
        for name in CLASS.findall(path.read_text(encoding="utf-8")):
            modules.setdefault(name, []).append(str(path.relative_to(ROOT)))
    assert {name: found for name, found in modules.items() if len(found) > 1} == {}
