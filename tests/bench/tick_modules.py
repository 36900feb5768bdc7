"""The modules that a position passes to become a setpoint: `python -m tests.bench.tick_modules`.

Two vehicles fly in formation in virtual time, with kernels that are not compiled, so that their modules count
as well. Noted are the modules whose code runs while a link reads, and from the begin of a tick until its
setpoints have been sent. The ports are in memory: those of `gcs/links/endpoints` are not seen.
"""

import os
import sys
from pathlib import Path
from types import FrameType
from typing import Final

if __name__ == "__main__" and os.environ.get("NUMBA_DISABLE_JIT") != "1":
    os.environ["NUMBA_DISABLE_JIT"] = "1"  # read when numba is imported
    os.execv(sys.executable, [sys.executable, "-m", "tests.bench.tick_modules"])  # noqa: S606 (this program)

from gcs.model.lifecycle import ShowPhase
from gcs.testing.virtual_show import VirtualShow, fly, show_config

ROOT: Final = Path(__file__).parents[2] / "gcs"
SETTLED_S, TRACED_S = 3.0, 2.0

NOTED: Final = {"Orchestrator._tick": "SetpointRouting.send", "Link._receive": "Link._receive"}
"""From the call of the one function until the other returns, modules are noted."""


class Tracer:
    """The modules that were entered, as paths in `gcs`, without fake vehicles and their ports."""

    def __init__(self) -> None:
        self.entered: set[str] = set()
        self._until: str | None = None

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event == "call":
            self._until = self._until or NOTED.get(code.co_qualname)
            if self._until and code.co_filename.startswith(f"{ROOT}{os.sep}"):
                self.entered.add(code.co_filename)
        elif event == "return" and code.co_qualname == self._until:
            self._until = None

    def modules(self) -> list[str]:
        inside = (Path(name).relative_to(ROOT).with_suffix("") for name in self.entered)
        return sorted(str(path) for path in inside if path.parts[0] not in {"sim", "testing"})


async def traced(show: VirtualShow) -> list[str]:
    await show.start()
    await show.reach(ShowPhase.RUNNING)
    await show.wait(SETTLED_S)
    tracer = Tracer()
    sys.setprofile(tracer)
    await show.wait(TRACED_S)
    sys.setprofile(None)
    return tracer.modules()


if __name__ == "__main__":
    print("\n".join(fly(traced, show_config(2))))
