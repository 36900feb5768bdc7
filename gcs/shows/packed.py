"""Shows as text, for other stations. A process of its own unpacks what arrives, whatever it contains.

`python -m gcs.shows.packed HASH` reads such a text and writes the show of this hash, pickled.
"""

import json
import os
import pickle
import subprocess
import sys
import zlib
from base64 import b64decode, b64encode
from binascii import Error as Base64Error
from typing import Final, TypeAlias

from pydantic import TypeAdapter

from gcs.model.errors import RefusedError
from gcs.service import ShowFigures, check_process
from gcs.service.check_process import FRUGAL, LOWER
from gcs.shows.format import Show
from gcs.shows.timeline import Timeline

UNPACKED_MAX_BYTES: Final = 500_000
"""Of a show as JSON, which for a file of 64 KiB is about 110 kB. To take one of this size over from the
process that unpacked it holds the interpreter's lock for 12 ms.
"""

UNPACKED_WITHIN_S: Final = 60.0
"""Two seconds of a core, of which a busy machine grants a tenth."""

MEMORY_MAX_BYTES: Final = 1 << 30

Unpacked: TypeAlias = tuple[str, Show, ShowFigures | None]
"""Name, show without its drawing, and the results of its check."""

_FIGURES: Final[TypeAdapter[ShowFigures | None]] = TypeAdapter(ShowFigures | None)


def packed(name: str, show: Show, figures: ShowFigures | None) -> str:
    """The text of a show. Raises: RefusedError for one that no station would unpack."""
    about = {
        "name": name,
        "show": show.model_dump(mode="json"),
        "figures": _FIGURES.dump_python(figures, mode="json"),
    }
    content = json.dumps(about, separators=(",", ":")).encode()
    if len(content) > UNPACKED_MAX_BYTES:
        raise RefusedError(f"show {name!r} is too large for the bus: {len(content)} bytes")
    return b64encode(zlib.compress(content)).decode()


def unpacked(text: str, show_hash: str) -> Unpacked:
    """The show of this text. Takes seconds for some texts. Raises: RefusedError if it is not of this hash."""
    try:
        reader = zlib.decompressobj()
        read = json.loads(reader.decompress(b64decode(text, validate=True), UNPACKED_MAX_BYTES))
        show = Show.model_validate_json(json.dumps(read["show"]))
        figures = _FIGURES.validate_python(read["figures"])
        if show.digest != show_hash:
            raise RefusedError(f"the show that arrived has the hash {show.digest}, not {show_hash[:64]}")
        Timeline.of(show)
        return str(read["name"])[:60], show, figures
    except (Base64Error, zlib.error, ValueError, LookupError, TypeError, RecursionError) as error:
        raise RefusedError(f"the show that arrived cannot be read: {error!r}"[:300]) from None


def unpacked_apart(text: str, show_hash: str) -> Unpacked:
    """As `unpacked`, by a process of a lower priority. Waits for it: for a thread beside control's."""
    with (
        subprocess.Popen(  # noqa: S603 (this program)
            [sys.executable, "-m", __name__, show_hash[:64]],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | FRUGAL,
        ) as process
    ):
        check_process.restrict(process.pid, LOWER, MEMORY_MAX_BYTES)
        try:
            answer, _ = process.communicate(text.encode(), UNPACKED_WITHIN_S)
        except subprocess.TimeoutExpired:
            process.kill()
            raise RefusedError(
                f"the show that arrived was not unpacked within {UNPACKED_WITHIN_S:g} s"
            ) from None
    if process.returncode:
        raise RefusedError(answer.decode(errors="replace") or "the show that arrived cannot be unpacked")
    unpacked: Unpacked = pickle.loads(answer)  # noqa: S301 (written by the lines below)
    return unpacked


def main(show_hash: str) -> int:
    """Unpack standard input. Returns: the exit code; with 1 the output says why."""
    try:
        sys.stdout.buffer.write(pickle.dumps(unpacked(sys.stdin.read(), show_hash)))
    except RefusedError as refused:
        sys.stdout.write(str(refused))
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
