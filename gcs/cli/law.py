"""`gcs law`: lists the laws of the formation, begins a new one, checks one, and chooses one."""

import argparse
import re
import sys
import time
from itertools import pairwise
from keyword import iskeyword
from pathlib import Path
from typing import TYPE_CHECKING, Final

from gcs.cli import remote
from gcs.cli.commands import ApiCall
from gcs.cli.output import answer
from gcs.model.errors import ConfigError

if TYPE_CHECKING:
    from gcs.formation.laws.protocol import FormationLaw

NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,30}")

TICK_S: Final = 0.05
"""Of the service, by default."""

TIMED: Final = 30
"""Vehicles with which the time of a law is measured."""

TAKEN: Final = frozenset({"FormationLaw", "GoalShape", "LawAnswer", "LawInputs", "Positive", "Settings"})
"""What a new law's file imports: its class cannot be called so."""


def class_name(law: str) -> str:
    """What the class of a new law is called."""
    return "".join(map(str.capitalize, law.split("_")))


SET: Final = ApiCall("law set", "change_formation", "choose the law, on the ground", ("law",), alone=True)


def add_law_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of `gcs law`."""
    actions = parser.add_subparsers(dest="action", required=True)
    actions.add_parser("list", help="every law that can be chosen, and in which shape a shipped one ends")
    new = actions.add_parser("new", help="write a small package with a law: a ring that turns")
    new.add_argument("name", metavar="NAME", help="of the law, and of the folder")
    check = actions.add_parser("check", help="check whether a law keeps what every law must")
    check.add_argument("name", metavar="NAME", help="as gcs law list has it, or module:Class of a file here")
    remote.add_call(actions.add_parser("set", help=SET.text), SET)


def run_law(arguments: argparse.Namespace) -> int:
    """Returns: 0; 1 for a law that fails its check. Raises: GcsError."""
    return {"list": _list, "new": _new, "check": _check}[arguments.action](arguments)


def _list(arguments: argparse.Namespace) -> int:
    from gcs.formation.laws.registry import SHIPPED, installed, law_at  # noqa: PLC0415 (loads numpy)

    rows = []
    for name, place in (SHIPPED | installed()).items():
        row = {"name": name, "place": place, "shipped": name in SHIPPED}
        if name in SHIPPED:
            law = law_at(place)
            row |= {"goal_shape": law.goal_shape.value, "stations": law.stations}
        rows.append(row)
    lines = [f"{row['name']:<16}{row['place']:<44}{row.get('goal_shape', '')}".rstrip() for row in rows]
    answer(arguments, rows, "\n".join(lines))
    return 0


def _new(arguments: argparse.Namespace) -> int:
    from gcs.cli.law_template import FILES  # noqa: PLC0415 (for this command only)
    from gcs.formation.laws.registry import SHIPPED  # noqa: PLC0415 (loads numpy)

    name, folder, kind = arguments.name, Path(arguments.name), class_name(arguments.name)
    if NAME.fullmatch(name) is None:
        text = "it is no name of Python: lower-case letters, digits and _ are possible, a letter first"
        raise ConfigError(f"law {name}: {text}, 31 at most")
    if name in SHIPPED:
        raise ConfigError(f"law {name}: a law of that name is shipped; take another name")
    if iskeyword(name) or iskeyword(kind) or kind in TAKEN:
        raise ConfigError(f"law {name}: {kind} is a word of Python, or of the law's file; take another name")
    if folder.exists():
        raise ConfigError(f"{folder}: it is there already; take another name, or remove it")
    words = {"NAME": name, "MODULE": f"{name}_law", "CLASS": kind}
    folder.mkdir()
    written = []
    for file, content in FILES.items():
        for word, value in words.items():
            file, content = file.replace(word, value), content.replace(word, value)  # noqa: PLW2901
        (folder / file).write_text(content, encoding="utf-8")
        written.append(str(folder / file))
    text = "\n".join([*written, f"next: pip install -e {name} && gcs law check {name}"])
    answer(arguments, {"name": name, "files": written}, text)
    return 0


def _check(arguments: argparse.Namespace) -> int:
    """Run the law's code in this process: a check is for the law's author."""
    from gcs.flight.features.laws.process import BUDGET_SHARE  # noqa: PLC0415 (loads numpy)
    from gcs.formation.laws.conformance import problems  # noqa: PLC0415
    from gcs.formation.laws.registry import allow_code, law_at, place_of  # noqa: PLC0415

    allow_code(Path.cwd())
    sys.path.insert(0, str(Path.cwd()))
    law = law_at(place_of(arguments.name))
    wrong, usual_ms = list(problems(law)), 0.0
    if not wrong:
        usual_ms, budget_ms = _usual_ms(law), 1e3 * BUDGET_SHARE * TICK_S
        if usual_ms > budget_ms:
            wrong.append(f"{TIMED} vehicles take {usual_ms:.1f} ms; its budget is {budget_ms:g} ms")
    document = {"name": arguments.name, "good": not wrong, "problems": wrong, "usual_ms": usual_ms}
    good = f"{arguments.name}: conforms; {TIMED} vehicles take {usual_ms:.2f} ms"
    answer(arguments, document, "\n".join(wrong) or good)
    return 1 if wrong else 0


def _usual_ms(law: "FormationLaw") -> float:
    """Processor time that nine of ten calls take at most; the time that half of them take if that is more."""
    from gcs.formation.laws.conformance import flown, sample  # noqa: PLC0415 (loads numpy)

    inputs, calls = sample(TIMED, law.settings()), 100
    clocks_s = [(time.process_time(), time.perf_counter())]
    clocks_s += [(time.process_time(), time.perf_counter()) for _ in flown(law, inputs, calls)]
    took_s = [(until[0] - since[0], until[1] - since[1]) for since, until in pairwise(clocks_s)]
    busy_s, whole_s = (sorted(times_s) for times_s in zip(*took_s, strict=True))
    usual_s: float = max(busy_s[calls * 9 // 10], whole_s[calls // 2])
    return 1e3 * usual_s
