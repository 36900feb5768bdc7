"""Laws that fly well for 2 s, and then do what no law may. Each runs in a process of its own."""

import os
import time
from pathlib import Path

import numpy as np

from gcs.formation.laws.protocol import FormationLaw, LawAnswer, LawInputs
from gcs.model.state import Array

WELL_TICKS = 40


class Hostile(FormationLaw):
    """Flies onto the sphere; its state is the number of ticks so far."""

    def velocity(self, inputs: LawInputs) -> LawAnswer:
        before = inputs.state if isinstance(inputs.state, int) else 0
        offset_m = inputs.position_m - inputs.center_m
        distance_m = np.linalg.norm(offset_m, axis=1, keepdims=True)
        well_m_s = np.clip(0.5 * (inputs.radius_m - distance_m), -2.0, 2.0) * offset_m / distance_m
        asked_m_s = well_m_s if before < WELL_TICKS else self.after(inputs, well_m_s, before)
        return LawAnswer(asked_m_s, before + 1)

    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        return well_m_s


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


class ToOnePoint(Hostile):
    """Within every bound of a law: what keeps vehicles apart is the filter."""

    def after(self, inputs: LawInputs, well_m_s: Array, tick: int) -> Array:
        offset_m = inputs.center_m - inputs.position_m
        towards: Array = 4.0 * offset_m / np.maximum(np.linalg.norm(offset_m, axis=1, keepdims=True), 0.1)
        return towards
