"""From a file to a show that is worth flying; every problem with its line and cue."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from gcs import documents
from gcs.errors import ConfigError, Problem, ShowError
from gcs.show.model import Show
from gcs.show.rules import Flaw, flaws
from gcs.show.source import Loc, Source
from gcs.show.timeline import Timeline

MAX_CHARACTERS = 1_000_000
"""Of a show file; a long one has some tens of thousands."""


@dataclass(frozen=True, slots=True, eq=False)
class LoadedShow:
    """A show without flaws, and where its parts stand in the file."""

    name: str  # the file's, without its ending
    file: str
    show: Show
    timeline: Timeline
    source: Source

    def problem(self, flaw: Flaw) -> Problem:
        """A flaw, with line and cue."""
        return located(flaw, self.source, [cue.cue for cue in self.show.timeline])


def load(path: Path) -> LoadedShow:
    """Read and check a show file.

    Raises: ShowError with everything that is wrong with it; ConfigError when it cannot be read.
    """
    return parse(documents.read(path), str(path))


def parse(text: str, file: str) -> LoadedShow:
    """The show in `text`; `file` names it in errors. Raises: ShowError, ConfigError."""
    if len(text) > MAX_CHARACTERS:
        raise ConfigError(f"{file}: {len(text)} characters: at most {MAX_CHARACTERS}")
    source = Source(text, file)
    raw = documents.parse_mapping(text, file, "about, origin, fleet, fence, timeline and duration_s")
    try:
        show = Show.model_validate(raw)
    except ValidationError as error:
        found = [Flaw(problem["loc"], _plain(problem)) for problem in _own(error.errors())]
        raise ShowError(file, _all_located(found, source, _names(raw))) from None
    found = flaws(show)
    if found:
        raise ShowError(file, _all_located(found, source, _names(raw)))
    return LoadedShow(Path(file).stem, file, show, Timeline.of(show), source)


def located(flaw: Flaw, source: Source, cues: list[str | None]) -> Problem:
    """Its line, and the cue it is about."""
    return Problem(source.line(*flaw.loc), _cue(flaw.loc, cues), flaw.text)


def _own(problems: list[ErrorDetails]) -> list[ErrorDetails]:
    """Without those that only follow from a problem inside them: a list lacks what could not be read."""
    return [
        problem
        for problem in problems
        if not any(
            len(other["loc"]) > len(problem["loc"]) and other["loc"][: len(problem["loc"])] == problem["loc"]
            for other in problems
        )
    ]


def _plain(problem: ErrorDetails) -> str:
    """Key, value and what would be right; line and cue are told beside it."""
    loc = problem["loc"]
    within = loc[2:] if loc[0] == "timeline" and len(loc) > 2 else loc
    return documents.plain(ErrorDetails({**problem, "loc": within}))


def _all_located(found: Iterable[Flaw], source: Source, cues: list[str | None]) -> list[Problem]:
    return [located(flaw, source, cues) for flaw in found]


def _cue(loc: Loc, cues: list[str | None]) -> str | None:
    if len(loc) < 2 or loc[0] != "timeline" or not isinstance(loc[1], int):
        return None
    return cues[loc[1]] if loc[1] < len(cues) else None


def _names(raw: dict[str, object]) -> list[str | None]:
    """Of the cues of a file that may be anything."""
    timeline = raw.get("timeline")
    entries = timeline if isinstance(timeline, list) else []
    names = [entry.get("cue") if isinstance(entry, dict) else None for entry in entries]
    return [None if name is None else str(name) for name in names]
