"""The table of one autopilot's versions: read from TOML, validated, and asked by version."""

import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import resources
from typing import Annotated, Final, TypeAlias

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from gcs.links.autopilots.versions.version import RELEASED, Release, Version

Number: TypeAlias = Annotated[Release, BeforeValidator(Release.parse)]
Value: TypeAlias = int | float

EARLIEST: Final = Release(0, 0)
LATEST: Final = Release(999, 0)


class _Entry(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Form(_Entry):
    """A parameter's name and unit in some versions."""

    name: str
    unit: str = ""
    until: Number = LATEST
    per_unit: float = 1.0  # in the newest version's unit
    whole: bool = False  # an integer, where the newest version has a real number
    values: Mapping[int, int] = {}  # by the newest version's number, where the numbers differ


class Parameter(_Entry):
    """A parameter by its newest name. It counts in versions from `since` to `until`, else not at all."""

    unit: str = ""
    since: Number = EARLIEST
    until: Number = LATEST
    default: Mapping[Number, Value] = {}  # as the firmware is delivered; by the first version that has it so
    begins: Mapping[int, Number] = {}  # of its numbers those that earlier versions do not know
    before: tuple[Form, ...] = ()  # names of earlier versions, the oldest first
    note: str = ""  # for the page of versions

    def form(self, name: str, release: Release) -> Form:
        """Its name and unit in this version."""
        newest = Form(name=name, unit=self.unit)
        return next((each for each in self.before if release <= each.until), newest)

    def counts(self, release: Release) -> bool:
        return self.since <= release <= self.until

    def knows(self, number: int, release: Release) -> bool:
        return release >= self.begins.get(number, EARLIEST)


class Proof(_Entry):
    """What is known of one version, and how."""

    by: str  # flown, recorded, or listed
    of: str  # which build, and what of it
    differs: str = ""  # from the version before


class Recorded(_Entry):
    """The version that the fake vehicles imitate."""

    flight_sw_version: Annotated[int, Field(gt=0)]
    lacks: frozenset[str] = frozenset()  # parameters that this build does not have yet

    @property
    def version(self) -> Version:
        return Version.decoded(self.flight_sw_version)


class Risk(_Entry):
    """What is known of a version that is newer than all that are supported."""

    since: Number
    text: str


class Versions(_Entry):
    """All that is known of one autopilot's versions."""

    title: str
    recorded: Recorded
    versions: Mapping[Number, Proof] = Field(min_length=1)  # the oldest first
    parameters: Mapping[str, Parameter]  # by the newest name
    meanings: tuple[str, ...]  # of modes, texts and fences, that changed; for the page of versions
    risks: tuple[Risk, ...] = ()

    @property
    def oldest(self) -> Release:
        return min(self.versions)

    @property
    def newest(self) -> Release:
        return max(self.versions)

    @property
    def supported(self) -> str:
        return f"{self.title} {self.oldest} to {self.newest}"

    def is_too_old(self, version: Version | None) -> bool:
        return version is not None and version.release < self.oldest

    def is_newer(self, version: Version | None) -> bool:
        """Whether it is newer than all that are supported."""
        return version is not None and version.release > self.newest

    def possible(self, version: Version | None) -> tuple[Release, ...]:
        """Supported versions as which it may behave, the oldest first: all where it is not known.

        A development build has some of what its version changes. A newer one is taken for the newest.
        """
        releases = tuple(self.versions)
        if version is None:
            return releases
        at = min(sum(release < version.release for release in releases), len(releases) - 1)
        first = at if version.is_released or self.is_newer(version) else max(at - 1, 0)
        return releases[first : at + 1]

    def form(self, name: str, release: Release) -> Form:
        """Name and unit of the parameter in one version, whether it counts there or not."""
        return self.parameters[name].form(name, release)

    def forms(self, name: str, possible: Sequence[Release]) -> tuple[Form, ...]:
        """Names and units that the parameter may have in those versions, the newest first."""
        parameter = self.parameters[name]
        of_each = (self.form(name, each) for each in reversed(possible) if parameter.counts(each))
        return tuple({form.name: form for form in of_each}.values())

    def read(self, name: str, values: Mapping[str, Value]) -> float | None:
        """The parameter's value under whichever name, in the newest version's unit; None: not there."""
        forms = (Form(name=name), *self.parameters[name].before)
        return next((values[each.name] / each.per_unit for each in forms if each.name in values), None)

    def least_default(self, name: str) -> float:
        """The smallest default of all supported versions, in the newest version's unit."""
        return float(min(self.parameters[name].default.values()))

    def recorded_or(self, versions: str) -> Version:
        """The version of this autopilot in a list such as "1.16,4.5"; the recorded one if there is none.

        Raises: ValueError.
        """
        chosen = [Release.parse(each) for each in versions.split(",") if each]
        own = [each for each in chosen if each.major == self.newest.major]
        return Version(own[0], 0, RELEASED) if own else self.recorded.version

    def lacks(self, name: str, version: Version) -> bool:
        """Whether the recorded build of that version lacks a parameter."""
        return version == self.recorded.version and name in self.recorded.lacks


@cache
def load(name: str) -> Versions:
    """The table `name`.toml of this package."""
    text = (
        resources.files("gcs.links.autopilots.versions").joinpath(f"{name}.toml").read_text(encoding="utf-8")
    )
    return Versions.model_validate(tomllib.loads(text))
