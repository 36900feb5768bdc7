"""Finds and reads the project's YAML files of every kind."""

from importlib import resources
from pathlib import Path
from typing import NamedTuple

from gcs.config.yaml_source import CHARACTERS_MAX
from gcs.model.errors import ConfigError


class Kind(NamedTuple):
    """A kind of file, with its folder."""

    plural: str  # its name in messages
    folder: str  # inside `configs`; "" is `configs` itself

    def shipped(self) -> list[Path]:
        """List the files that come with the package, by name."""
        return sorted((shipped_folder() / self.folder).glob("*.yaml"))

    def find(self, name: str) -> Path:
        """Find a file by path, else a shipped one by name. Raises: ConfigError that names the shipped ones.

        Works from a checkout and from an installed wheel.
        """
        path = Path(name)
        if path.is_file():
            return path
        inside = shipped_folder() / self.folder / f"{path.name.removesuffix('.yaml')}.yaml"
        if path.parent in {Path(), Path("configs") / self.folder} and inside.is_file():
            return inside
        if path.is_dir():
            inside_it = next((found.name for found in sorted(path.glob("*.yaml"))), "FILE.yaml")
            raise ConfigError(f"{name}: it is a folder: name the file in it, such as {path / inside_it}")
        known = ", ".join(found.stem for found in self.shipped())
        raise ConfigError(f"{name}: there is no such file; {self.plural} that come with the package: {known}")


CONFIGURATIONS = Kind("configurations", "")
SHOWS = Kind("shows", "shows")
SCENARIOS = Kind("scenarios", "scenarios")


def shipped_folder() -> Path:
    """Folder of the configurations: inside an installed wheel, or beside `gcs` in a checkout."""
    package = Path(str(resources.files("gcs")))
    packed = package / "_configs"
    return packed if packed.is_dir() else package.parent / "configs"


def read(path: Path) -> str:
    """Read the text of a file. Raises: ConfigError when it cannot be read."""
    try:
        with path.open("rb") as file:
            data = file.read(4 * CHARACTERS_MAX + 1)
    except IsADirectoryError:
        raise ConfigError(f"{path}: cannot be read: it is a folder: name the file in it") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from None
    if len(data) > 4 * CHARACTERS_MAX:
        raise ConfigError(f"{path}: cannot be read: larger than {4 * CHARACTERS_MAX} bytes")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        where = f"line {line}: byte {error.start} (0x{data[error.start]:02x})"
        raise ConfigError(f"{path}: cannot be read: {where} is not UTF-8: save the file as UTF-8") from None
