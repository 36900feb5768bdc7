"""Files that are small and stand for a lot, or break what reads them: refused at once, by line and column."""

import asyncio
import json
import tracemalloc
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from gcs.cli import main
from gcs.config.schema import parse as parse_config
from gcs.config.yaml_files import DEPTH_MAX, Source
from gcs.model.errors import SHOWN_MAX, FileError, InvalidError, RefusedError, quoted
from gcs.service.check_process import answered
from gcs.shows import parse as parse_show

pytestmark = pytest.mark.usefixtures("prompt_checks")

LEVELS = range(5, 10)
MEMORY_MAX_BYTES = 4 << 20
"""Of what is read: the bomb of nine levels stands for 3 GB."""


def bomb(levels: int) -> str:
    """As the user review's: each level is nine of the level before."""
    lines = [f"about: &a0 [{', '.join(['lol'] * 9)}]"]
    lines += [f"k{level}: &a{level} [{', '.join([f'*a{level - 1}'] * 9)}]" for level in range(1, levels)]
    return "\n".join(lines) + "\n"


def refused(read: Callable[[str, str], object], text: str) -> FileError:
    with pytest.raises(FileError) as caught:
        read(text, "bomb.yaml")
    return caught.value


@pytest.mark.parametrize("levels", LEVELS)
@pytest.mark.parametrize("read", [parse_config, parse_show])
def test_yaml_bomb_is_refused_with_line_before_expansion(
    read: Callable[[str, str], object], levels: int
) -> None:
    text = bomb(levels)
    assert len(text) < 600
    tracemalloc.start()
    try:
        error = refused(read, text)
        _, peak_bytes = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert str(error) == (
        "bomb.yaml: line 1: column 8: &a0: anchors are not allowed: write the value out where it is needed"
    )
    assert peak_bytes < MEMORY_MAX_BYTES


@pytest.mark.parametrize("levels", LEVELS)
@pytest.mark.usefixtures("logging_restored")
def test_command_line_refuses_a_yaml_bomb_in_one_line(
    levels: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "bomb.yaml"
    file.write_text(bomb(levels))
    assert main(["show", "check", str(file), "--json"]) == 1
    output = capsys.readouterr().out
    (problem,) = json.loads(output)["problems"]
    assert (problem["line"], problem["text"][:14]) == (1, "column 8: &a0:")
    assert len(output) < 1000
    assert main(["params", "check", "--config", str(file)]) == 2
    assert "line 1: column 8" in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: *b", "line 1: column 4: *b: aliases are not allowed"),
        ("a: 1\nb: {<<: {c: 1}}", "line 2: column 5: <<: merge keys are not allowed"),
        ("a:\n  b: !!python/name:os.system x", "line 2: column 6: !!python/name:os.system: tags are not"),
        ("a: " + "[" * 40, f"nested deeper than {DEPTH_MAX} levels"),
        ("a: [" + "1," * 100_001 + "]", "more than 100000 values"),
        ("a: " + "x" * 1_000_001, "characters: at most 1000000"),
        ("a: 1\nb: \x07", "line 2: not YAML: character U+0007 is not allowed"),
        ("a: 1\n---\nb: 2", "line 2: column 1: not YAML"),
        ("{a: 1, a: 2}", "line 1: key 'a' is there twice"),
    ],
)
def test_unsupported_yaml_is_refused_with_its_place(text: str, words: str) -> None:
    assert words in str(refused(Source, text))


def test_scalars_are_numbers_only_in_number_form() -> None:
    text = "[yes, no, on, off, 12:30, 1_000, 010, 1e3, -.5, .inf, true, ~, 0x10, 2020-01-01, '7']"
    parsed: Any = Source(text, "x").value()
    infinite = float("inf")
    assert parsed == [
        *("yes", "no", "on", "off", "12:30", "1_000", 10, 1000.0, -0.5, infinite, True, None, 16),
        *("2020-01-01", "7"),
    ]


def test_no_value_makes_a_message_long() -> None:
    deep: list[Any] = []
    for _ in range(2000):
        deep = [deep] * 9
    for value in ("x" * 10**6, ["y" * 1000] * 1000, deep, {"a": deep}, 10**3000, b"\x00" * 10**5):
        assert len(quoted(value)) <= SHOWN_MAX
    assert len(str(InvalidError("radius_m", "9" * 10**5, "at most 5 m"))) < 2 * SHOWN_MAX
    text = f"duration_s: {'z' * 900}\nabout: [{', '.join(['0'] * 900)}]\n{'k' * 900}: 1\n"
    error = refused(parse_show, text)
    assert max(map(len, str(error).splitlines())) < 300


def test_of_many_problems_the_first_are_listed() -> None:
    cues = "\n".join(f"  - {{cue: a{at}, at_s: x}}" for at in range(400))
    error = refused(parse_show, f"about: x\ntimeline:\n{cues}\n")
    assert len(error.problems) == 101
    assert "more from here on" in error.problems[-1].text


class Noting(ThreadPoolExecutor):
    """Remembers what it was given to do."""

    def __init__(self) -> None:
        super().__init__(max_workers=1)
        self.given: list[object] = []

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Any:
        self.given += fn.args if isinstance(fn, partial) else (fn,)
        return super().submit(fn, *args, **kwargs)


@pytest.fixture
def broken_show(tmp_path: Path) -> str:
    file = tmp_path / "bomb.yaml"
    file.write_text(bomb(9))
    return str(file)


def asked(file: str, **bounds: Any) -> tuple[dict[str, Any], list[object]]:
    """What `gcs show check` answers, and what the loop had others do."""

    async def ask() -> tuple[dict[str, Any], list[object]]:
        executor = Noting()
        asyncio.get_running_loop().set_default_executor(executor)
        return await answered(("show", "check", file, "--json"), 300.0, **bounds), executor.given

    return asyncio.run(ask())


def test_answer_is_read_in_a_process_and_parsed_off_the_loop(broken_show: str) -> None:
    answer, given = asked(broken_show)
    assert answer["good"] is False
    assert json.loads in given


def test_a_process_that_prints_too_much_is_ended(broken_show: str) -> None:
    with pytest.raises(RefusedError, match=r"it was ended: it printed more than 0 KiB"):
        asked(broken_show, answer_max_bytes=100)


def test_process_above_its_memory_limit_fails_with_a_message(broken_show: str) -> None:
    with pytest.raises(RefusedError, match="it ended with"):
        asked(broken_show, memory_max_bytes=96 << 20)
