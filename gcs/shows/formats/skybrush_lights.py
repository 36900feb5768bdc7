"""Light programs of Skybrush: byte code of colours, fades and loops, expanded to pieces, and written. Pure.

Commands are one byte, with arguments; durations are counts of 20 ms as variable-length integers, 7 bits a
byte, lowest first. Source, as facts: skybrush-io/libskybrush, src/lights/commands.h and executor.cpp.
"""

from base64 import b64decode, b64encode
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from gcs.model.errors import DrawingError
from gcs.shows.drawn.light_programs import LightProgram, constant
from gcs.shows.drawn.piece_index import TIME_MAX_S

TICK_S: Final = 0.02
PROGRAM_MAX_BYTES: Final = 256 * 1024
PIECES_MAX: Final = 20_000
"""Of one program, loops written out: a change every 0.36 s for two hours, or 67 a second for five minutes."""

STEPS_MAX: Final = 50_000
"""Commands that one program executes; a loop without a duration ends here."""

LOOPS_MAX: Final = 4
"""Depth of loops: CONFIG_MAX_LOOP_DEPTH of libskybrush."""

_END, _NOP, _SLEEP, _WAIT, _LOOP, _LOOP_END, _RESET = 0, 1, 2, 3, 12, 13, 14
_SET: Final = range(4, 8)  # colour, gray, black, white
_FADE: Final = range(8, 12)
_PYRO: Final = (20, 21)
_NOT_FLOWN: Final = {
    16: "colours from radio channels",
    17: "colours from radio channels",
    18: "jumps",
    19: "jumps on a radio channel",
}
_TICKS_MAX: Final = round(TIME_MAX_S / TICK_S)


@dataclass
class _Pieces:
    """Pieces so far, times in ticks."""

    times: list[int] = field(default_factory=lambda: [0])
    before: list[tuple[int, int, int]] = field(default_factory=list)
    after: list[tuple[int, int, int]] = field(default_factory=list)
    now: tuple[int, int, int] = (0, 0, 0)

    @property
    def ticks(self) -> int:
        return self.times[-1]

    def add(self, ticks: int, after: tuple[int, int, int]) -> None:
        """Add a piece from the present colour; a constant one lengthens a constant one of the same colour."""
        if ticks and self.now == after and self.after and self.before[-1] == self.after[-1] == after:
            self.times[-1] += ticks
        elif ticks:
            self.times.append(self.ticks + ticks)
            self.before.append(self.now)
            self.after.append(after)
        self.now = after

    def program(self) -> LightProgram:
        if self.before and self.after[-1] != self.now:  # set at the very end, without a duration
            self.add(1, self.now)
        if not self.before:
            return constant(*self.now)
        before, after = np.array(self.before, np.uint8), np.array(self.after, np.uint8)
        return LightProgram(np.array(self.times) * TICK_S, before, after)


class _Interpreter:
    """Executes a program to its end; one without an end up to a time."""

    def __init__(self, code: bytes, place: str) -> None:
        self._code, self._place = code, place
        self._at = 0
        self._loops: list[tuple[int, int]] = []  # where it begins, passages left; 0: without end
        self.pieces = _Pieces()
        self.pyro = False
        self.steps = 0
        self.cut = False  # it is too long to be executed to its end

    def _wrong(self, text: str) -> DrawingError:
        return DrawingError(self._place, f"byte {self._at}: {text}")

    def _byte(self) -> int:
        if self._at >= len(self._code):
            raise self._wrong("the program ends within a command")
        self._at += 1
        return self._code[self._at - 1]

    def _ticks(self) -> int:
        ticks = shift = 0
        while True:
            byte = self._byte()
            ticks |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return min(ticks, _TICKS_MAX)
            if shift > 28:
                raise self._wrong("a duration of more than 5 bytes")

    def _colour(self, kind: int) -> tuple[int, int, int]:
        if kind == 0:
            return self._byte(), self._byte(), self._byte()
        gray = self._byte() if kind == 1 else 255 * (kind == 3)
        return gray, gray, gray

    def run(self, until: int) -> None:
        """Execute until the program ends; in an endless loop, or beyond a bound, until `until` ticks."""
        for self.steps in range(STEPS_MAX):
            if self._at >= len(self._code) or self.pieces.ticks >= _TICKS_MAX:
                return
            if self.pieces.ticks >= until and any(passages == 0 for _, passages in self._loops):
                return
            if not self._execute(self._byte()):
                return
            if len(self.pieces.before) > PIECES_MAX:
                self._bounded(until, f"{PIECES_MAX} colours")
                return
        self._bounded(until, f"{STEPS_MAX} commands")

    def _bounded(self, until: int, most: str) -> None:
        """Raises: DrawingError, unless what is missing comes after `until`."""
        if self.pieces.ticks < until:
            raise self._wrong(f"more than {most}, loops written out")
        self.cut = True

    def _execute(self, command: int) -> bool:
        """Execute one command. Returns: whether the program goes on."""
        pieces = self.pieces
        if command in _SET:
            pieces.now = self._colour(command - _SET.start)
            pieces.add(self._ticks(), pieces.now)
        elif command in _FADE:
            after = self._colour(command - _FADE.start)
            pieces.add(self._ticks(), after)
        elif command == _SLEEP:
            pieces.add(self._ticks(), pieces.now)
        elif command == _WAIT:
            pieces.add(max(self._ticks() - pieces.ticks, 0), pieces.now)
        elif command in {_LOOP, _LOOP_END}:
            self._loop(command)
        elif command in _PYRO:
            self._byte()
            self.pyro = True
        elif command not in {_END, _NOP, _RESET}:
            self._at -= 1
            what = _NOT_FLOWN.get(command, f"command {command}")
            raise self._wrong(f"{what}: not known to this station")
        return command != _END

    def _loop(self, command: int) -> None:
        if command == _LOOP:
            if len(self._loops) == LOOPS_MAX:
                raise self._wrong(f"loops nested deeper than {LOOPS_MAX}")
            passages = self._byte()
            self._loops.append((self._at, passages))
            return
        if not self._loops:
            raise self._wrong("the end of a loop that did not begin")
        begin, passages = self._loops.pop()
        if passages != 1:
            self._loops.append((begin, passages - 1 if passages else 0))
            self._at = begin


class Decoded(NamedTuple):
    """What a program does, and how many commands that took."""

    program: LightProgram
    fires_pyro: bool
    steps: int
    is_cut: bool  # it goes on for longer than is read


def decoded(data: str, place: str, until_s: float) -> Decoded:
    """Execute a program in base64 to its own end; one without an end up to a time.

    Raises: DrawingError, at `place`, with the byte at which the program is wrong.
    """
    if len(data) > PROGRAM_MAX_BYTES * 4 // 3:
        raise DrawingError(place, f"{len(data)} characters: at most {PROGRAM_MAX_BYTES} bytes of code")
    try:
        code = b64decode(data, validate=True)
    except ValueError as error:  # or text that is not ASCII
        raise DrawingError(place, f"not base64: {error}") from None
    interpreter = _Interpreter(code, place)
    interpreter.run(min(int(until_s / TICK_S) + 1, _TICKS_MAX))
    return Decoded(interpreter.pieces.program(), interpreter.pyro, interpreter.steps, interpreter.cut)


def encoded(program: LightProgram) -> str:
    """Return a program in base64. Its times are rounded to 20 ms, without drift."""
    ticks = np.rint(program.times_s / TICK_S).astype(int).tolist()
    code = bytearray()
    now: list[int] | None = None
    pieces = zip(ticks, ticks[1:], program.before.tolist(), program.after.tolist(), strict=False)
    for begin, end, before, after in pieces:
        if before == after:
            code += bytes((_SET.start, *after)) + _varint(end - begin)
        else:
            if before != now:
                code += bytes((_SET.start, *before, 0))
            code += bytes((_FADE.start, *after)) + _varint(end - begin)
        now = after
    return b64encode(bytes(code) + bytes((_END,))).decode()


def _varint(value: int) -> bytes:
    found = bytearray()
    while value >= 0x80:
        found.append((value & 0x7F) | 0x80)
        value >>= 7
    return bytes((*found, value))
