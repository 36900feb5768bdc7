"""Laws by name: those that are shipped, those of installed packages, and code beside a configuration.

A package names its laws as entry points of the group `gcs.laws`. `module:Class` is a file beside the
configuration; it is found only after `allow_code` has named that folder.
"""

from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, Final, TypeAlias, get_args

from pydantic import AfterValidator, Field

from gcs.formation.laws.protocol import FormationLaw, GoalShape, LawAnswer, LawInputs, Stations, waits
from gcs.model.errors import InvalidError
from gcs.model.settings import Settings

GROUP: Final = "gcs.laws"
SHIPPED: Final = {
    "slots": "gcs.formation.laws.slots:Slots",
    "article": "gcs.formation.laws.article:Article",
    "neighbours": "gcs.formation.laws.neighbours:Neighbours",
    "flocking": "gcs.formation.laws.flocking:Flocking",
}
"""Where each law of this package is. A package cannot replace one of them."""


_beside: list[str] = []
"""The folder of code that may run beside what is installed; none unless `allow_code` has named it."""

_declared: dict[str, FormationLaw] = {}
"""What laws of other packages declare, received from their processes."""


def allow_code(folder: Path) -> None:
    """Let `module:Class` name a law in that folder."""
    _beside[:] = [str(folder.resolve())]


def code_folder() -> str:
    """That folder; empty: there is none."""
    return "".join(_beside)


@cache
def installed() -> dict[str, str]:
    """Where the laws of other packages are, by name."""
    points = sorted((point.name, point.value) for point in entry_points(group=GROUP))
    return {name: place for name, place in points if name not in SHIPPED}


def names() -> tuple[str, ...]:
    """Every law that can be chosen by name."""
    return (*SHIPPED, *installed())


def place_of(name: str) -> str:
    """`module:Class` of a law. Raises: InvalidError when there is none of this name."""
    place = SHIPPED.get(name) or installed().get(name)
    if place is not None:
        return place
    module, is_place, _ = name.partition(":")
    if not is_place:
        raise InvalidError("law", name, "one of " + ", ".join(names()))
    if not _beside:
        raise InvalidError("law", name, "code beside the configuration runs only with --allow-law-code")
    if not Path(code_folder(), f"{module}.py").is_file():
        raise InvalidError("law", name, f"a file {module}.py in {code_folder()}")
    return name


@cache
def law_at(place: str) -> FormationLaw:
    """The law at `module:Class`: runs the module's code. Raises: InvalidError when there is no law."""
    module, _, name = place.partition(":")
    kind = getattr(import_module(module), name, None)
    if not (isinstance(kind, type) and issubclass(kind, FormationLaw)):
        raise InvalidError("law", place, "a class that inherits gcs.formation.laws.protocol.FormationLaw")
    _check_words(place, kind)
    law: FormationLaw = kind()
    return law


def _check_words(place: str, kind: type[FormationLaw]) -> None:
    """Raises: InvalidError unless what a law says of itself is what a station reads."""
    model: object = kind.settings
    if not (isinstance(model, type) and issubclass(model, Settings)):
        text = "a class that inherits gcs.model.settings.Settings, which refuses NaN"
        raise InvalidError(f"{place}: settings", kind.settings, text)
    if kind.goal_shape not in set(GoalShape):
        raise InvalidError(f"{place}: goal_shape", kind.goal_shape, "one of " + ", ".join(GoalShape))
    if kind.stations not in get_args(Stations):
        raise InvalidError(f"{place}: stations", kind.stations, "one of " + ", ".join(get_args(Stations)))


class Plugin(FormationLaw):
    """A law of another package as the station knows it: its code runs in a process of its own, never here.

    The same stands for a law that this computer does not have, in a plan that another one made.
    """

    def __init__(
        self, goal_shape: GoalShape = GoalShape.NONE, *, adds_spin: bool = False, led: bool = False
    ) -> None:
        self.goal_shape, self.adds_spin = goal_shape, adds_spin
        self.stations = "led" if led else "local"

    def velocity(self, inputs: LawInputs) -> LawAnswer:
        return waits(len(inputs.ids))


def declare(
    name: str, goal_shape: GoalShape = GoalShape.NONE, *, adds_spin: bool = False, led: bool = False
) -> None:
    """Store what a law declares."""
    _declared[name] = Plugin(goal_shape, adds_spin=adds_spin, led=led)


def law_of(name: str) -> FormationLaw:
    """The law of that name; a tick never ends with an error where there is none."""
    return law_at(SHIPPED[name]) if name in SHIPPED else _declared.get(name) or Plugin()


def _checked(name: str) -> str:
    try:
        place_of(name)
    except InvalidError as error:
        raise ValueError(error.allowed) from None
    return name


LawName: TypeAlias = Annotated[str, Field(min_length=1, max_length=64), AfterValidator(_checked)]
"""The name of a law that there is, as settings have it."""
