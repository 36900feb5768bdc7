"""Loads a show file that can be flown; reports every problem with its line and cue."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from gcs.config import yaml_files as documents
from gcs.config.setting_errors import Misfit, misfits
from gcs.config.yaml_files import Loc, Source
from gcs.model.errors import FileError, Problem, ShowError
from gcs.shows.format import Show
from gcs.shows.timeline import Timeline
from gcs.shows.validation import Flaw, flaws


@dataclass(frozen=True, slots=True, eq=False)
class LoadedShow:
    """A show without flaws, and the lines of its parts in the file."""

    name: str  # the file's, without its suffix
    file: str
    show: Show
    timeline: Timeline
    source: Source

    def problem(self, flaw: Flaw) -> Problem:
        """Return a flaw with line and cue."""
        return located(flaw, self.source, [cue.cue for cue in self.show.timeline])


def load(path: Path) -> LoadedShow:
    """Read and check a show file.

    Raises: ShowError with everything that is wrong with it; ConfigError when it cannot be read.
    """
    return parse(documents.read(path), str(path))


def parse(text: str, file: str) -> LoadedShow:
    """Parse the show in `text`; `file` names it in errors. Raises: ShowError."""
    try:
        source = Source(text, file)
        raw = source.mapping("about, origin, fleet, fence, timeline and duration_s")
    except FileError as error:
        raise ShowError(error.file, error.problems) from None
    try:
        show = Show.model_validate(raw)
    except ValidationError as error:
        found = [Flaw(misfit.loc, _within_cue(misfit)) for misfit in misfits(error, Show, source)]
        raise ShowError(file, _all_located(found, source, _names(raw))) from None
    found = flaws(show)
    if found:
        raise ShowError(file, _all_located(found, source, _names(raw)))
    return LoadedShow(Path(file).stem, file, show, Timeline.of(show), source)


def located(flaw: Flaw, source: Source, cues: list[str | None]) -> Problem:
    """Return a flaw with its line and cue."""
    return Problem(source.line(*flaw.loc), _cue(flaw.loc, cues), flaw.text)


def _within_cue(misfit: Misfit) -> str:
    """Describe key, value and what is allowed; line and cue are shown beside it."""
    loc, key = misfit.loc, misfit.key
    if len(loc) > 2 and loc[0] == "timeline":
        key = key.removeprefix(f"timeline.{loc[1]}.")
    return str(misfit._replace(key=key))


def _all_located(found: Iterable[Flaw], source: Source, cues: list[str | None]) -> list[Problem]:
    return [located(flaw, source, cues) for flaw in found]


def _cue(loc: Loc, cues: list[str | None]) -> str | None:
    if len(loc) < 2 or loc[0] != "timeline" or not isinstance(loc[1], int):
        return None
    return cues[loc[1]] if loc[1] < len(cues) else None


def _names(raw: dict[str, object]) -> list[str | None]:
    """Return the names of the cues of an unvalidated file."""
    timeline = raw.get("timeline")
    entries = timeline if isinstance(timeline, list) else []
    names = [entry.get("cue") if isinstance(entry, dict) else None for entry in entries]
    return [None if name is None else str(name) for name in names]
