"""What a vehicle's phase does not say: the flags beside it, and how a change of the phase changes them. Pure.

The phase (`gcs.model.lifecycle`) says what a vehicle does, and its flags how it does it. They change in two
ways, and in no other:

1. A maneuver sets and drops the first three, while the vehicle is in the phase that the table names.
2. A change of the phase keeps a flag only in the phases in which the table keeps it; `after` also sets the
   last two, which nothing else does.

| flag | set | kept |
| --- | --- | --- |
| `entering_offboard` | in HOLD, before OFFBOARD is commanded | until the phase changes |
| `follows_planned_path` | in RETURN, with a goal on a path planned for all | until the phase changes |
| `handed_over` | in LANDING, when the autopilot's own landing begins | until the phase changes |
| `pilot_in_control` | in PILOT, unless only the link lost setpoints and it holds | in LOST and KILLED |
| `rejoins` | when it leaves FORMATION without a command | in LOST and PILOT |
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from gcs.model.lifecycle import Phase

KEPT: Final[Mapping[str, frozenset[Phase]]] = {
    "pilot_in_control": frozenset({Phase.LOST, Phase.KILLED}),
    "rejoins": frozenset({Phase.LOST, Phase.PILOT}),
}
"""Phases in which a flag stays as it was before the change; in every other it is dropped."""


@dataclass(frozen=True, slots=True)
class Flags:
    """How a vehicle does what its phase says."""

    entering_offboard: bool = False  # setpoints already flow so that OFFBOARD can be accepted
    follows_planned_path: bool = False  # its goal follows a path planned for the whole fleet
    handed_over: bool = False  # the autopilot's own LAND touches down
    pilot_in_control: bool = False  # or its own failsafe, until handed back, silent or not
    rejoins: bool = False  # lost from the formation, and nothing commanded since

    def after(self, before: Phase, phase: Phase, *, only_link_lost: bool) -> "Flags":
        """The flags after a change of the phase; `only_link_lost`: it just holds without setpoints."""
        rejoins = self.rejoins or before is Phase.FORMATION
        return Flags(
            pilot_in_control=self._pilot(phase, only_link_lost=only_link_lost),
            rejoins=rejoins and phase in KEPT["rejoins"],
        )

    def _pilot(self, phase: Phase, *, only_link_lost: bool) -> bool:
        if phase is Phase.PILOT:
            return not only_link_lost
        return self.pilot_in_control and phase in KEPT["pilot_in_control"]
