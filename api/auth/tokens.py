"""The token file: names, roles, and SHA-256 of the tokens, never the tokens themselves."""

import fcntl
import hmac
import logging
import os
import secrets
import time
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from stat import S_IRWXG, S_IRWXO
from tempfile import mkstemp
from typing import Annotated, Final

from pydantic import Field, ValidationError

from gcs.model.errors import ConfigError, RefusedError, UnknownError
from gcs.model.settings import Settings
from gcs.service.access import ANONYMOUS, LOCAL, Role

log = logging.getLogger(__name__)

RANDOM_BYTES: Final = 32

RESERVED: Final = frozenset({ANONYMOUS, LOCAL, "service"})
"""Names that records use for calls without a token."""


class Entry(Settings):
    """One token of the file: its name, role and hash."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.@-]{0,63}$")]
    role: Role
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    created_unix_time_s: float


class TokenFile(Settings):
    """The whole token file."""

    tokens: tuple[Entry, ...] = ()


def read_tokens(path: Path) -> tuple[Entry, ...]:
    """Read the token file. Raises: ConfigError that names the file and its problem."""
    try:
        text = path.read_bytes()
        mode = path.stat().st_mode
    except OSError as error:
        raise ConfigError(
            f"{path}: the tokens cannot be read: {error.strerror};"
            f" gcs token create NAME --role operate --file {path} makes the file"
        ) from None
    if mode & (S_IRWXG | S_IRWXO):
        log.warning("token_file_open", extra={"file": str(path), "fix": f"chmod 600 {path}"})
    try:
        entries = TokenFile.model_validate_json(text).tokens
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "the whole"
        raise ConfigError(f"{path}: no token file: {where}: {first['msg']}") from None
    twice = {entry.name for entry in entries if sum(entry.name == other.name for other in entries) > 1}
    if twice:
        raise ConfigError(f"{path}: {', '.join(sorted(twice))} is there twice")
    return entries


def create_token(path: Path, name: str, role: Role) -> str:
    """Create a token and add its name and hash to the file. The token itself cannot be read from the file.

    Raises: ConfigError when the file is invalid or cannot be written; RefusedError for a name that is taken.
    """
    token = f"gcs_{secrets.token_urlsafe(RANDOM_BYTES)}"
    if name in RESERVED:
        raise RefusedError(
            f"{name} is the name that records use for callers without a token: choose another name"
        )
    try:
        entry = Entry(name=name, role=role, sha256=hashed(token), created_unix_time_s=time.time())
    except ValidationError:
        raise RefusedError(
            f"{name!r}: a name is up to 64 letters, digits, '_', '.', '@', '-', and begins with one of the"
            " first two"
        ) from None
    with _changing(path):
        entries = read_tokens(path) if path.exists() else ()
        if any(known.name == name for known in entries):
            raise RefusedError(f"{path}: there is a token {name} already; revoke it, or choose another name")
        _write(path, (*entries, entry))
    return token


def revoke_token(path: Path, name: str) -> None:
    """Remove a token; a running service notices at its next call. Raises: ConfigError, UnknownError."""
    with _changing(path):
        entries = read_tokens(path)
        left = tuple(entry for entry in entries if entry.name != name)
        if len(left) == len(entries):
            known = ", ".join(entry.name for entry in entries) or "none"
            raise UnknownError(f"{path}: there is no token {name}; there are {known}")
        _write(path, left)


def hashed(token: str) -> str:
    """Hash of a token, as stored. Without salt or stretching: 256 random bits cannot be guessed."""
    return sha256(token.encode()).hexdigest()


class Tokens:
    """The tokens of a file, which is read again when it has changed."""

    def __init__(self, path: Path) -> None:
        """Raises: ConfigError when the file is invalid or holds no token."""
        self._path = path
        self._entries = read_tokens(path)
        self._version = self._look()
        if not self._entries:
            raise ConfigError(f"{path}: no token in it; gcs token create NAME --role operate --file {path}")

    def find(self, token: str) -> Entry | None:
        """Return the entry of a token, in constant time for every token, valid or not."""
        self._refresh()
        given = hashed(token)
        found = None
        for entry in self._entries:
            if hmac.compare_digest(entry.sha256, given):
                found = entry
        return found

    def has(self, entry: Entry) -> bool:
        self._refresh()
        return entry in self._entries

    def _look(self) -> tuple[int, int, int] | None:
        try:
            found = self._path.stat()
        except OSError:
            return None
        return found.st_ino, found.st_mtime_ns, found.st_size

    def _refresh(self) -> None:
        """Read a changed file. An unreadable one changes nothing: operators can still stop the fleet."""
        version = self._look()
        if version == self._version:
            return
        self._version = version
        try:
            self._entries = read_tokens(self._path)
        except ConfigError as error:
            log.error("tokens_not_read_again", extra={"cause": str(error)})
        else:
            log.info("tokens_read_again", extra={"names": [entry.name for entry in self._entries]})


@contextmanager
def _changing(path: Path) -> Iterator[None]:
    """Lock the file: two commands at the same time would lose a token."""
    try:
        folder = os.open(path.parent, os.O_RDONLY)
    except OSError as error:
        raise ConfigError(f"{path.parent}: cannot be opened: {error.strerror}") from None
    try:
        fcntl.flock(folder, fcntl.LOCK_EX)
        yield
    finally:
        os.close(folder)


def _write(path: Path, entries: tuple[Entry, ...]) -> None:
    """Write the file atomically, readable by its owner only."""
    try:
        handle, new = mkstemp(dir=path.parent, prefix=f".{path.name}.")  # mode 600
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(TokenFile(tokens=entries).model_dump_json(indent=2) + "\n")
            file.flush()
            os.fsync(file.fileno())
        Path(new).replace(path)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from None
