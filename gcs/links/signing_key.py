"""The file of a signing key, and the newest signing time beside it. Loads fast: a kill waits for it."""

import logging
import os
from base64 import b64decode
from binascii import Error as Base64Error
from contextlib import suppress
from pathlib import Path
from stat import S_IRWXG, S_IRWXO

from gcs.mavlink.signing_time import KEY_BYTES, TIME_MAX
from gcs.model.errors import ConfigError, LinkError

log = logging.getLogger(__name__)


def load_key(path: Path) -> bytes:
    """32 bytes: as they are, or written in hex or base64. Raises: ConfigError naming file and length."""
    try:
        with path.open("rb") as file:
            data = file.read(4096)
            mode = os.fstat(file.fileno()).st_mode
    except OSError as error:
        raise ConfigError(f"{path}: the signing key cannot be read: {error.strerror}") from None
    if mode & (S_IRWXG | S_IRWXO):
        log.warning("key_file_open", extra={"file": str(path), "fix": f"chmod 600 {path}"})
    for key in (data, _decoded(data)):
        if len(key) == KEY_BYTES:
            return key
    raise ConfigError(
        f"{path}: {len(data)} bytes; a signing key is {KEY_BYTES} bytes, or those in hex or base64"
    )


def time_file(key_file: Path, link_id: int) -> Path:
    """The file with the newest signing time of a link."""
    return key_file.with_name(f"{key_file.name}.link{link_id}.time")


def reserve(file: Path, time: int) -> int:
    """Write a time that no signature will have reached. Returns: the time. Raises: OSError."""
    time = min(time, TIME_MAX)
    new = file.with_name(f"{file.name}.new")
    with new.open("w", encoding="ascii") as opened:
        opened.write(f"{time}\n")
        opened.flush()
        os.fsync(opened.fileno())
    new.replace(file)
    return time


def _decoded(data: bytes) -> bytes:
    """Key from hex or base64, with white space around it; empty when it is neither."""
    text = data.strip()
    with suppress(ValueError):
        return bytes.fromhex(text.decode("ascii"))
    with suppress(Base64Error, ValueError):
        return b64decode(text, validate=True)
    return b""


def stored(file: Path) -> int:
    """The time in the file; 0 when there is none. Raises: LinkError."""
    try:
        text = file.read_text(encoding="ascii").strip()
    except FileNotFoundError:
        return 0
    except (OSError, UnicodeDecodeError) as error:
        raise LinkError(f"{file}: the time of signatures cannot be read: {error}") from error
    if not text.isdecimal() or int(text) > TIME_MAX:
        raise LinkError(f"{file}: holds no time of signatures")
    return int(text)
