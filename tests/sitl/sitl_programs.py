"""Where PX4 and ArduCopter are on this machine, or what to get and where it was looked for."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

DEEPEST = 4
"""Folders below the given one in which a program is looked for: build/px4_sitl_default/bin/px4."""

PRUNED = frozenset({".git", "src", "modules", "libraries", "test_data", "ROMFS", "node_modules"})
ANSWERS_S = 20.0


class NotFoundError(FileNotFoundError):
    """There is no such program; the message says what to get and where it was looked for."""


@dataclass(frozen=True, slots=True)
class Program:
    """A program that flies, and how to get it."""

    name: str
    file_name: str
    variables: tuple[str, ...]  # of the environment, which name it or a folder
    folders: tuple[str, ...]  # in which people build it
    how_to_get: str


PX4 = Program(
    "PX4",
    "px4",
    ("PX4", "PX4_BUILD", "PX4_DIR", "PX4_HOME"),
    ("~/PX4-Autopilot", "~/src/PX4-Autopilot", "~/px4", "../PX4-Autopilot", "/opt/px4", "/usr/local/px4"),
    "git clone --recursive https://github.com/PX4/PX4-Autopilot, a tag from v1.14.0 on, there "
    "`make px4_sitl_default`; then make sitl PX4=/path/to/PX4-Autopilot. "
    "Or an image that runs SIH: make sitl PX4_IMAGE=px4io/px4-sitl",
)
ARDUCOPTER = Program(
    "ArduCopter",
    "arducopter",
    ("ARDUPILOT", "ARDUPILOT_HOME", "ARDUCOPTER"),
    ("~/ardupilot", "~/src/ardupilot", "../ardupilot", "/opt/ardupilot", "/usr/local/ardupilot"),
    "git clone --recursive https://github.com/ArduPilot/ardupilot, a tag from Copter-4.0 on, there "
    "`./waf configure --board sitl && ./waf copter`; then make sitl ARDUPILOT=/path/to/ardupilot",
)


def find(program: Program, given: str | None = None) -> Path:
    """The program, in what was given (itself, or a folder above it), or where people keep it.

    Raises: NotFoundError.
    """
    looked: list[str] = []
    for place, words in _places(program, given):
        looked.append(words)
        if (found := _in(place, program.file_name)) is not None:
            return found.resolve()
    raise NotFoundError(
        f"no {program.name} was found. Looked in: {'; '.join(looked)}. Get it: {program.how_to_get}"
    )


def px4_files(program: Path) -> Path:
    """The folder `etc` of a PX4's start scripts. Raises: NotFoundError."""
    tried = [parent / "etc" for parent in (program.parent.parent, program.parent)]
    for folder in tried:
        if (folder / "init.d-posix/rcS").is_file():
            return folder
    scripts = " and ".join(str(folder / "init.d-posix/rcS") for folder in tried)
    raise NotFoundError(f"{program} has no start scripts: there is no {scripts}. Get it: {PX4.how_to_get}")


def container_engine(image: str) -> str:
    """Docker or podman, once it has the image. Raises: NotFoundError."""
    engine = shutil.which("docker") or shutil.which("podman")
    if engine is None:
        raise NotFoundError("neither docker nor podman is installed: PX4_IMAGE needs one of them")
    asked = subprocess.run(
        [engine, "image", "inspect", "--format", "{{.Id}}", image],
        capture_output=True, text=True, timeout=ANSWERS_S, check=False,
    )  # fmt: skip
    if asked.returncode != 0:
        why = asked.stderr.strip() or f"exit code {asked.returncode}"
        raise NotFoundError(
            f"{engine} has no image {image} ({why}). Get it: {Path(engine).name} pull {image}"
        )
    return engine


def _places(program: Program, given: str | None) -> Iterator[tuple[Path, str]]:
    """Where it may be, each with words for it."""
    if given is not None:
        yield Path(given).expanduser(), given
        return
    for variable in program.variables:
        value = os.environ.get(variable, "")
        if value:
            yield Path(value).expanduser(), f"{variable}={value}"
    unset = [variable for variable in program.variables if not os.environ.get(variable)]
    on_path = shutil.which(program.file_name)
    words = f"the environment ({', '.join(unset)}: not set)" if unset else "the environment"
    yield Path(on_path or f"{program.file_name}, which is not there"), f"{words}, PATH ({program.file_name})"
    for folder in program.folders:
        yield Path(folder).expanduser(), folder


def _in(place: Path, program: str) -> Path | None:
    """The program itself, or the newest one in that folder."""
    if place.is_file():
        return place if os.access(place, os.X_OK) else None
    found = list(_below(place, program, DEEPEST)) if place.is_dir() else []
    return max(found, key=lambda file: file.stat().st_mtime, default=None)


def _below(folder: Path, program: str, deepest: int) -> Iterator[Path]:
    try:
        entries = sorted(folder.iterdir())
    except PermissionError:
        return
    for entry in entries:
        if entry.name == program and entry.is_file() and os.access(entry, os.X_OK):
            yield entry
        elif deepest and entry.is_dir() and not entry.is_symlink() and entry.name not in PRUNED:
            yield from _below(entry, program, deepest - 1)
