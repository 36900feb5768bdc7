"""The page "Tested with", from the tables: `make tested-with`."""

import sys
from collections.abc import Iterator

from gcs.links.autopilots.versions.table import EARLIEST, Parameter, Versions, load

TABLES = ("px4", "ardupilot")

HEAD = """\
# Tested with

Made from `gcs/links/autopilots/versions/*.toml` by `make tested-with`: change the tables, not this page.

*Flown*: a real autopilot of that version flew with this station. *Recorded*: it was flown and recorded
before, and the fake vehicles imitate it. *Listed*: its published parameters and its source were compared with
what this station demands. No vehicle of it has flown. Tests resolve all demands in each version against its
published list (`tests/data/autopilots/`), and apply them to a vehicle on the wire that has it.

The station reads the version from AUTOPILOT_VERSION. `gcs preflight` shows it, and `--json` has it for each
vehicle. A version older than the oldest below is refused. A newer one is taken for the newest: what is there
and holds is accepted, a parameter that is missing is refused by its name, and the report lists the version
under *not checked*. A development build is taken for its version or the one before. Where no version is
reported, the names of the parameters tell.
"""


def page() -> str:
    """The whole page."""
    return "\n".join([HEAD, *(line for name in TABLES for line in _autopilot(load(name)))])


def _autopilot(table: Versions) -> Iterator[str]:
    yield from (f"## {table.title}", "", "| Version | | Which | What is different |", "|---|---|---|---|")
    for release, proof in table.versions.items():
        yield f"| {release} | {proof.by} | {proof.of} | {proof.differs} |"
    yield from ("", "What changed its meaning:", "")
    yield from (f"- {text}" for text in table.meanings)
    yield from (f"- {risk.since} (not supported): {risk.text}." for risk in table.risks)
    yield from ("", "Parameters whose name, unit, default or presence differs:", "")
    yield from ("| Newest name | Unit | Versions | Before | As delivered | |", "|---|---|---|---|---|---|")
    for name, parameter in table.parameters.items():
        since, until = max(parameter.since, table.oldest), min(parameter.until, table.newest)
        if parameter.before or len(parameter.default) > 1 or (since, until) != (table.oldest, table.newest):
            yield _row(name, parameter, f"{since}" if since == until else f"{since} to {until}")
    yield ""


def _row(name: str, parameter: Parameter, versions: str) -> str:
    before = "; ".join(
        f"until {form.until} `{form.name}`{f' in {form.unit}' if form.per_unit != 1.0 else ''}"
        for form in parameter.before
    )
    first, *later = parameter.default.items() or [(EARLIEST, "not published")]
    default = "; ".join([f"{first[1]}", *(f"from {release} {value}" for release, value in later)])
    cells = (f"`{name}`", parameter.unit, versions, before, default, parameter.note)
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    sys.stdout.write(page())
