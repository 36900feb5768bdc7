"""Laws that fly well for some time, and then do what no law may. Each runs in a process of its own."""

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np

from gcs.formation.laws.protocol import FormationLaw, LawAnswer, LawInputs
from gcs.model.settings import Settings
from gcs.model.state import Array

WELL_TICKS = 40

REASONS = {
    "SleepsASecond": "it took longer than 10 ms in 5 ticks",
    "NeverReturns": "it took longer than 10 ms in 5 ticks",
    "Fails": "ZeroDivisionError: no vehicle is left (hostile_laws.py, line ",
    "NotANumber": "its velocity of d4 is [nan, nan, nan]",
    "Infinite": "its velocity of d1 is [",
    "WrongShape": "it returned an array of shape (19, 3); (20, 3) is needed",
    "HundredToOnePoint": "it asks for 100 m/s, more than 2",
    "Toggles": "it reverses a velocity 4 times within 8 ticks",
    "TakesMemory": "MemoryError",
    "EndsItsProcess": "its process ended",
    "ChangesItsInputs": "ValueError: assignment destination is read-only",
    "AnswersItself": "its process sends what is no answer",
    "AnswersNested": "its process sends what is no answer",
    "ShortensTheTable": "PermissionError: [Errno 1] Operation not permitted (hostile_laws.py, line ",
    "Forks": "it took longer than 10 ms in 5 ticks",
    "PrintsEndlessly": "it took longer than 10 ms in 5 ticks",
    "TakesModulesAway": "ModuleNotFoundError: import of json halted",
    "TakesNoSignal": "it took longer than 10 ms in 5 ticks",
    "WritesToTheTerminal": "ValueError: \\x1b[2Jall is well (hostile_laws.py, line ",
}
"""Laws, and with what words their alarm begins."""

IN_WHOLE_SHOWS = (
    "Fails",
    "SleepsASecond",
    "NotANumber",
    "Infinite",
    "WrongShape",
    "HundredToOnePoint",
    "Toggles",
    "TakesMemory",
)


class HostileSettings(Settings):
    """When a law does what it may not, and where."""

    well_ticks: int = WELL_TICKS
    """So many ticks it flies well before."""
    where: str = ""
    """At stations whose first vehicle has a name that begins so; empty: at all."""
    marks: str = ""
    """A file that then has the time of the monotonic clock."""


class Hostile(FormationLaw):
    """Flies onto the sphere; its state is the number of ticks so far."""

    settings = HostileSettings

    def velocity(self, inputs: LawInputs) -> LawAnswer:
        settings = HostileSettings.model_validate(inputs.settings)
        before = inputs.state if isinstance(inputs.state, int) else 0
        offset_m = inputs.position_m - inputs.center_m
        distance_m = np.linalg.norm(offset_m, axis=1, keepdims=True)
        well_m_s = np.clip(0.5 * (inputs.radius_m - distance_m), -2.0, 2.0) * offset_m / distance_m
        well = before < settings.well_ticks or not inputs.ids[0].startswith(settings.where)
        if not well and settings.marks and not Path(settings.marks).exists():
            Path(settings.marks).write_text(str(time.monotonic()), encoding="ascii")
        return LawAnswer(well_m_s if well else self.after(inputs, well_m_s, before), before + 1)

    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        return well_m_s


def file_named(begins: str) -> int:
    """The number of the open file, above the standard ones, that is named so."""
    files = [each for each in Path("/proc/self/fd").iterdir() if int(each.name) > 2 and each.is_symlink()]
    return next(int(each.name) for each in files if str(each.readlink()).startswith(begins))


class SleepsASecond(Hostile):
    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        time.sleep(1.0)
        return well_m_s


class NeverReturns(Hostile):
    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        while True:
            pass


class Fails(Hostile):
    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        raise ZeroDivisionError("no vehicle is left")


class NotANumber(Hostile):
    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        well_m_s[3] = np.nan
        return well_m_s


class Infinite(Hostile):
    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        return well_m_s / 0.0


class WrongShape(Hostile):
    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        return well_m_s[:-1]


class HundredToOnePoint(Hostile):
    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        offset_m = inputs.center_m - inputs.position_m
        towards: Array = 100.0 * offset_m / np.linalg.norm(offset_m, axis=1, keepdims=True)
        return towards


class Toggles(Hostile):
    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        return np.full_like(well_m_s, 3.0 if tick % 2 else -3.0)


class TakesMemory(Hostile):
    def __init__(self) -> None:
        self.kept: list[bytes] = []

    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        self.kept.append(bytes(100_000_000))
        return well_m_s


class EndsItsProcess(Hostile):
    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        os._exit(0)


class ChangesItsInputs(Hostile):
    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        inputs.position_m[:] = 0.0
        return well_m_s


class AnswersItself(Hostile):
    """Writes what its process sends."""

    answer = b"no answer\n" * 1000

    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        for number in range(3, 30):
            if Path(f"/proc/self/fd/{number}").exists():
                os.write(number, self.answer)
        return well_m_s


class AnswersNested(AnswersItself):
    """Deeper than a parser of JSON goes."""

    answer = b"[" * 4000 + b"\n"


class ShortensTheTable(Hostile):
    """Takes the shared memory away, and says that its answer is there."""

    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        os.ftruncate(file_named("/memfd:"), 0)
        os.write(file_named("pipe:"), b'{"took_s": 0.001}\n')
        time.sleep(1.0)
        return well_m_s


class Forks(Hostile):
    """Leaves children behind that have its pipes, and ends."""

    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        if os.fork() == 0:
            time.sleep(600.0)
        os._exit(0)


class PrintsEndlessly(Hostile):
    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        while True:
            sys.stdout.write("x" * 1000)


class TakesModulesAway(Hostile):
    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        for name in list(sys.modules):
            sys.modules[name] = None  # type: ignore[assignment]
        import json  # noqa: F401, PLC0415

        return well_m_s


class TakesNoSignal(Hostile):
    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGALRM):
            signal.signal(number, signal.SIG_IGN)
        while True:
            pass


class WritesToTheTerminal(Hostile):
    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        raise ValueError("\x1b[2Jall is\nwell")


class LedFails(Fails):
    stations = "led"


class LedSleepsASecond(SleepsASecond):
    stations = "led"


class ToOnePoint(Hostile):
    """Within every bound of a law: what keeps vehicles apart is the filter."""

    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        offset_m = inputs.center_m - inputs.position_m
        towards: Array = 4.0 * offset_m / np.maximum(np.linalg.norm(offset_m, axis=1, keepdims=True), 0.1)
        return towards
