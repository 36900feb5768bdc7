"""Pages of the documentation site that are generated from the code, so that they cannot become untrue.

MkDocs calls the functions `on_*` (mkdocs.yml). Generated are the command line, the configuration, the
REST API and one page for each Python package. The entries `reference/python/` and `decisions/history/` of the
nav become the pages in those folders.
"""

import json
import posixpath
import re
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any, Final

from markdown.extensions.toc import slugify
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from gcs.api.app import routed
from gcs.cli.commands import ACTIONS, CALLS, COMMANDS
from gcs.cli.main import make_parser, overview
from gcs.config.schema import Config

ROOT: Final = Path(__file__).parents[2]
REPOSITORY: Final = "https://github.com/formation-gcs/formation-gcs/blob/main"

PYTHON: Final = "reference/python"
HISTORY: Final = "decisions/history"

LISTED_LAST: Final = "---\nsearch: {boost: 0.001}\n---"
"""In a search, where a match in a title counts 1000 times as much, and here each attribute is a title."""

CONFIGURATION: Final = """\
---
search: {boost: 4}
---

# Configuration

A configuration is one YAML file; `configs/` has examples. An unknown key is an error. The names of quantities
end in their unit; `links[n]` is each of a list. [Set up the station](../operations/administrator.md)
explains the sections in use."""

SEVERAL: Final = ("anyOf", "oneOf", "allOf")

CLOSED: Final = "*History, closed: the [index](index.md) names the page that has what still holds.*"
"""Below the title of each numbered decision on the site; the files stay as they were written."""

CLOSED: Final = "*History, closed: the [index](index.md) names the page that has what still holds.*"
"""Below the title of each numbered decision on the site; the files stay as they were written."""

SUCCESS: Final = ("200", "201", "202", "204", "101")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Replace the nav's folders by the pages in them."""
    folders = {
        f"{PYTHON}/": [f"{PYTHON}/{name}.md" for name, _ in packages()],
        f"{HISTORY}/": [
            f"{HISTORY}/index.md",
            *(f"{HISTORY}/{path.name}" for path in sorted((ROOT / "docs" / HISTORY).glob("0*.md"))),
        ],
    }
    config.nav = _expanded(config.nav, folders)
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    pages = {
        "reference/cli.md": command_line(),
        "reference/configuration.md": configuration(),
        "reference/rest.md": rest(routed().openapi()),
        **{f"{PYTHON}/{name}.md": python_package(name, folder) for name, folder in packages()},
    }
    for path, text in pages.items():
        files.append(File.generated(config, path, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Point links that leave docs/ to the repository, and mark the history of decisions."""
    if page.file.src_uri.startswith(f"{HISTORY}/0"):
        page.meta["search"] = {"boost": 0.2}
        title, _, text = markdown.partition("\n")
        markdown = f"{title}\n\n{CLOSED}\n{text}"
    folder = posixpath.dirname(posixpath.join("docs", page.file.src_uri))

    def absolute(link: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(folder, link[1]))
        return link[0] if target.startswith("docs/") else f"]({REPOSITORY}/{target})"

    return re.sub(r"\]\((\.\./[^)#\s]+)\)", absolute, markdown)


def packages() -> list[tuple[str, Path]]:
    """Name and folder of every Python package that is installed, sorted."""
    found = []
    for top in (ROOT / "gcs", ROOT / "api", ROOT / "sim"):
        prefix = "gcs" if top.name == "gcs" else f"gcs.{top.name}"
        for init in top.rglob("__init__.py"):
            inside = init.parent.relative_to(top).parts
            if "node_modules" not in inside:
                found.append((".".join((prefix, *inside)), init.parent))
    return sorted(set(found))


def python_package(name: str, folder: Path) -> str:
    """One package: its docstring, then its modules."""
    modules = sorted(path.stem for path in folder.glob("*.py") if not path.stem.startswith("_"))
    blocks = [f"::: {name}", *(f"::: {name}.{module}" for module in modules)]
    return "\n\n".join([LISTED_LAST, f"# {name}", *blocks]) + "\n"


def command_line() -> str:
    """`--help` of every command."""
    names = [*COMMANDS, *(each.name for each in (*CALLS, *ACTIONS))]
    parts = ["# Command line", _preformatted(overview())]
    for name in names:
        parts += [f"## gcs {name}", _preformatted(make_parser(name).format_help())]
    return "\n\n".join(parts) + "\n"


def configuration() -> str:
    """Every section of a configuration file under the path of its key: what is allowed, default, meaning."""
    schema = Config.model_json_schema()
    paths = dict(_sections(schema, schema["$defs"], "", set()))
    text = json.dumps(schema)
    for name, path in paths.items():
        text = text.replace(f'"#/$defs/{name}"', json.dumps(f"#/$defs/{path}"))
    schema = json.loads(text)
    parts = [CONFIGURATION, "## Top level", _fields(schema)]
    for name, path in paths.items():
        definition = schema["$defs"][name]
        parts += [f"## {path}", _text(definition["description"]), _fields(definition), _choices(definition)]
    return "\n\n".join(part for part in parts if part) + "\n"


def _sections(
    node: dict[str, Any], definitions: dict[str, Any], path: str, listed: set[str]
) -> Iterator[tuple[str, str]]:
    """Name of each definition and the path of the first key that has it, in the order of a file."""
    name = node.get("$ref", "").rpartition("/")[2]
    if name and name not in listed:
        listed.add(name)
        yield name, path
        yield from _sections(definitions[name], definitions, path, listed)
    for each in chain.from_iterable(node.get(several, []) for several in SEVERAL):
        yield from _sections(each, definitions, path, listed)
    if "items" in node:
        yield from _sections(node["items"], definitions, f"{path}[n]", listed)
    for key, field in node.get("properties", {}).items():
        yield from _sections(field, definitions, f"{path}.{key}" if path else key, listed)


def rest(document: dict[str, Any]) -> str:
    """Every path and every schema of the OpenAPI document."""
    parts = [
        "# REST API",
        _text(document["info"]["description"]),
        "A running service answers the same as `/openapi.json`, and as pages to try calls on at `/docs`.",
    ]
    for path, methods in document["paths"].items():
        for method, call in methods.items():
            parts += [
                f"## {method.upper()} {path}",
                f"**{call.get('summary', '')}**",
                _text(call.get("description", "")),
            ]
            parts += [_parameters(call), _body(call), _responses(call)]
    parts.append("## Schemas")
    for name, schema in sorted(document["components"]["schemas"].items()):
        parts += [f"### {name}", _text(schema.get("description", "")), _fields(schema), _choices(schema)]
    return "\n\n".join(part for part in parts if part) + "\n"


def _expanded(nav: Any, folders: dict[str, list[str]]) -> Any:
    if isinstance(nav, str):
        return folders.get(nav, nav)
    if isinstance(nav, dict):
        return {name: _expanded(inside, folders) for name, inside in nav.items()}
    return [_expanded(inside, folders) for inside in nav or []]


def _preformatted(text: str) -> str:
    return f"```text\n{text.rstrip()}\n```"


def _text(text: str) -> str:
    """Of a docstring, as Markdown of one level."""
    return re.sub(r"^#", r"\\#", text.strip(), flags=re.MULTILINE)


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _fields(schema: dict[str, Any]) -> str:
    """A table of a schema's properties; empty without any."""
    required = schema.get("required", [])
    rows = [
        (f"`{name}`", _kind(field), _default(field, name in required), field.get("description", ""))
        for name, field in schema.get("properties", {}).items()
    ]
    return _table(("Key", "Type", "Default", "Meaning"), rows)


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """A Markdown table; empty without rows."""
    lines = [f"| {' | '.join(map(_cell, row))} |" for row in (head, tuple("---" for _ in head), *rows)]
    return "\n".join(lines) if rows else ""


def _choices(schema: dict[str, Any]) -> str:
    """The values of an enumeration; empty without any."""
    values = ", ".join(f"`{value}`" for value in schema.get("enum", []))
    return f"One of {values}." if values else ""


def _default(field: dict[str, Any], required: bool) -> str:
    if required:
        return "required"
    default = field.get("default")
    if isinstance(default, dict):
        return "as its keys"
    shown = default if isinstance(default, str) else json.dumps(default)
    return f"`{shown}`" if "default" in field else ""


def _kind(field: dict[str, Any]) -> str:
    """Type and bounds of a property."""
    return " or ".join(dict.fromkeys(_kinds(field))) or "any"


def _kinds(field: dict[str, Any]) -> Iterator[str]:
    for several in SEVERAL:
        for each in field.get(several, []):
            yield from _kinds(each)
    if "$ref" in field:
        name = field["$ref"].rpartition("/")[2]
        yield f"[{name}](#{slugify(name, '-')})"
    elif "enum" in field:
        yield ", ".join(f"`{value}`" for value in field["enum"])
    elif "const" in field:
        yield f"`{field['const']}`"
    elif field.get("type") == "array":
        yield f"list of {_kind(field.get('items', {}))}"
    elif "type" in field:
        yield " ".join([field["type"], *_bounds(field)])


def _bounds(field: dict[str, Any]) -> Iterator[str]:
    words = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    for key, sign in words.items():
        if key in field:
            yield f"{sign} {field[key]:g}"


def _parameters(call: dict[str, Any]) -> str:
    rows = [
        (f"`{each['name']}`", each["in"], _kind(each["schema"]), each.get("description", ""))
        for each in call.get("parameters", [])
    ]
    return _table(("Parameter", "In", "Type", "Meaning"), rows)


def _body(call: dict[str, Any]) -> str:
    contents = call.get("requestBody", {}).get("content", {})
    return "\n".join(f"Body ({kind}): {_kind(each.get('schema', {}))}" for kind, each in contents.items())


def _responses(call: dict[str, Any]) -> str:
    """The answers: of success with their type, of errors by number."""
    answers = call.get("responses", {})
    lines = []
    for code in (code for code in answers if code in SUCCESS):
        contents = answers[code].get("content", {})
        kinds = [f"{_kind(each['schema'])}" for each in contents.values() if each.get("schema")]
        lines.append(f"- {code}: {' or '.join(kinds) or _cell(answers[code]['description'])}")
    errors = sorted(code for code in answers if code not in SUCCESS)
    if errors:
        lines.append(f"- errors, as [ErrorBody](#errorbody): {', '.join(errors)}")
    return "\n".join(lines)
