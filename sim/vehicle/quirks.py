"""A switch for each of PX4's habits that a ground station must handle (FACTS, section 3)."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


class QuirkError(ValueError):
    """There is no such quirk."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Quirks:
    """On is PX4's behaviour; off is the ideal one. On the command line `_` is written `-`."""

    own_origin: bool = True
    """1: each local NED origin is the vehicle's own first fix; off: all have the fleet's."""
    late_ready: bool = True
    """2: ready to arm 4 to 6 s after start; off: after 0.1 s."""
    double_ack: bool = True
    """3: DO_SET_MODE is acknowledged ACCEPTED at once, then with the result; off: with the result only."""
    starved_offboard: bool = True
    """4: OFFBOARD without setpoints is accepted disarmed, then arming is refused; in the air it is refused.
    Off: both are accepted."""
    setpoint_loss: bool = True
    """5: COM_OBL_RC_ACT acts COM_OF_LOSS_T after the last setpoint; off: the last setpoint stays in force."""
    resume: bool = True
    """6: OFFBOARD resumes by itself when setpoints return; off: only by command."""
    mode_reverts: bool = True
    """7: after landing and disarming the mode falls back, for example to OFFBOARD; off: to HOLD."""
    quiet_texts: bool = True
    """8: texts only while a ground station's heartbeats arrive; off: always."""
    late_heartbeat: bool = True
    """9: a mode change shows in the next HEARTBEAT, up to 1 s late; off: one is sent at every change."""
    whole_velocity: bool = True
    """10: a velocity with a missing axis is not followed; off: its given axes are."""
    early_takeoff: bool = True
    """11: NAV_TAKEOFF while disarmed is accepted and happens at the next arming; off: it is refused."""
    disarm_refused: bool = True
    """11: DISARM in the air is refused; off: it stops the motors."""
    slow_clock: bool = True
    """12: the boot clock loses 1 to 2 %; off: it is exact. (Jumps are faults: clock-jump, reboot.)"""
    patient_offboard: bool = True
    """13: OFFBOARD continues at 2 Hz, up to COM_OF_LOSS_T between setpoints; off: 0.25 s is too long."""

    def changed(self, changes: Iterable[tuple[str, bool]]) -> Quirks:
        """A copy with these switches set; names as on the command line.

        Raises:
            QuirkError: no such quirk.
        """
        known = set(names())
        desired = dict(changes)
        for name in desired:
            if name not in known:
                raise QuirkError(f"{name}: no such quirk; there are {', '.join(names())}")
        return replace(self, **{name.replace("-", "_"): on for name, on in desired.items()})


def names() -> tuple[str, ...]:
    """All quirks, as on the command line."""
    return tuple(field.name.replace("_", "-") for field in fields(Quirks))
