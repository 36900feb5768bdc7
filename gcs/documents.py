"""YAML files of ours, of whatever kind: found, read strictly, and what is wrong with them in words."""

from collections.abc import Hashable
from importlib import resources
from pathlib import Path
from typing import NamedTuple

import yaml
from pydantic import ValidationError
from pydantic_core import ErrorDetails

from gcs.errors import ConfigError


class Kind(NamedTuple):
    """What people write files for."""

    plural: str  # as people call them
    folder: str  # inside `configs`; "" is that itself

    def shipped(self) -> list[Path]:
        """Those that come with the package, by name."""
        return sorted((shipped_folder() / self.folder).glob("*.yaml"))

    def find(self, name: str) -> Path:
        """A file: a path as it is, else a shipped one. Raises: ConfigError naming what there is.

        Works from a checkout and from an installed wheel.
        """
        path = Path(name)
        if path.is_file():
            return path
        inside = shipped_folder() / self.folder / f"{path.name.removesuffix('.yaml')}.yaml"
        if path.parent in {Path(), Path("configs") / self.folder} and inside.is_file():
            return inside
        known = ", ".join(found.stem for found in self.shipped())
        raise ConfigError(f"{name}: there is no such file; {self.plural} that come with the package: {known}")


CONFIGURATIONS = Kind("configurations", "")
SHOWS = Kind("shows", "shows")
SCENARIOS = Kind("scenarios", "scenarios")


def shipped_folder() -> Path:
    """Where the configurations lie: inside an installed wheel, or beside `gcs` in a checkout."""
    package = Path(str(resources.files("gcs")))
    packed = package / "_configs"
    return packed if packed.is_dir() else package.parent / "configs"


def read(path: Path) -> str:
    """The text of a file. Raises: ConfigError when it cannot be read."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from None


class _StrictLoader(yaml.SafeLoader):
    """YAML in which a repeated key is an error."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, object]:
        """As SafeLoader, after looking for repetitions."""
        seen: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue  # refused below
            if key.value in seen:
                raise ConfigError(f"line {key.start_mark.line + 1}: key '{key.value}' is there twice")
            seen.add(key.value)
        return super().construct_mapping(node, deep=deep)


def parse_mapping(text: str, source: str, needed: str) -> dict[str, object]:
    """The YAML mapping in `text`, no key twice; `needed` says what it should hold. Raises: ConfigError."""
    try:
        raw = yaml.load(text, Loader=_StrictLoader)  # noqa: S506  (a SafeLoader, stricter)
    except yaml.YAMLError as error:
        raise ConfigError(f"{source}: not YAML: {error}") from None
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}") from None
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        # PyYAML's own constructors, of a month 13 or a tag that does not fit its value
        raise ConfigError(f"{source}: not YAML: {error}") from None
    if not isinstance(raw, dict):
        raise ConfigError(f"{source}: a mapping is needed, with {needed}")
    return {str(key): value for key, value in raw.items()}


def explained(error: ValidationError, source: str) -> ConfigError:
    """What a reader of `source` can mend: every key, its value and what would be right."""
    return ConfigError(f"{source}: " + "; ".join(plain(problem) for problem in error.errors()))


def plain(problem: ErrorDetails) -> str:
    """Key, value and what would be right; without the value where it is a whole section."""
    key = ".".join(str(part) for part in problem["loc"])
    value = "" if isinstance(problem["input"], dict) else f" = {problem['input']!r}"
    return f"{key}{value}: {problem['msg'].removeprefix('Value error, ')}".removeprefix(": ")
