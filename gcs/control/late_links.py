"""Settings of a tick while links are late."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, TypeVar

import numpy as np

from gcs.control.inputs import ControlSettings
from gcs.formation.laws.protocol import RATES_S
from gcs.model.response import FleetResponse
from gcs.model.settings import Settings
from gcs.model.state import Array, Mask

Kind = TypeVar("Kind", bound=Settings)

LATE_S: Final = 0.06
"""From this delay on, one way, the tick counts with it. Less is what the law's gains were found with."""


LOOP_S: Final = 0.1
"""Greatest delay of the inner loop on the measured velocity."""


STEP_S: Final = 0.1
"""The delay is rounded up to steps of this length, so that settings do not change with every sample."""


KEPT_S: Final = 0.02
"""A step is kept until the delay leaves it by more."""


MOST_S: Final = 0.6
"""Greatest delay given to the filter: beyond it no velocity would satisfy its bounds."""


SHARE: Final = 0.9
"""Quantile of the vehicles' delays that is taken as the fleet's delay."""


TRIM_SHARE: Final = 0.2
"""Factor on the trim's learning rate while links are late."""


def fleet_delay_s(delay_s: Array, flying: Mask, before_s: float = 0.0) -> float:
    """One-way delay of the flying vehicles: 0 while links are fast, else a multiple of `STEP_S`.

    Args:
        delay_s: (n,) of each link.
        flying: (n,) vehicles that count.
        before_s: the result of the tick before.
    """
    flying_s = delay_s[flying]
    if not np.count_nonzero(flying_s >= LATE_S - KEPT_S):  # as nearly always: the quantile takes longer
        return 0.0
    fleet_s = float(np.quantile(flying_s, SHARE))
    if before_s and max(before_s - STEP_S, LATE_S) - KEPT_S < fleet_s <= before_s + KEPT_S:
        return before_s
    if fleet_s < LATE_S:
        return 0.0
    return min(MOST_S, STEP_S * float(np.ceil(fleet_s / STEP_S - 1e-6)))


def _scaled(settings: Kind, names: Sequence[str], share: float) -> Kind:
    return settings.model_copy(update={name: share * getattr(settings, name) for name in names})


SLOWER: Final = ("slot_rate_per_s", "goal_rate_per_s", "sphere_rate_per_s", "spreading_rate_per_s")
"""Rates, as settings name them, that become slower with late links."""


def _slower(settings: Kind, share: float) -> Kind:
    """Settings of the law, or of one of its parts, with these shares of their rates."""
    parts = {name: _slower(part, share) for name, part in settings if isinstance(part, Settings)}
    rates = [name for name in SLOWER if name in type(settings).model_fields]
    return _scaled(settings.model_copy(update=parts), rates, share)


def for_late_links(control: ControlSettings, delay_s: float) -> ControlSettings:
    """Settings of the tick at this delay or the configured one, of telemetry and setpoints alike.

    The filter keeps the floor if it knows the delay. Beyond `LOOP_S` the inner loop on the measured velocity
    is off: it oscillates when its own effect is measured late. Decisions 0004, 0024 and 0060.
    """
    late_s = max(delay_s, control.safety.link_delay_s)
    changes: dict[str, object] = {}
    if late_s > control.safety.link_delay_s:
        changes["safety"] = control.safety.model_copy(update={"link_delay_s": late_s})
    if late_s > LOOP_S:
        changes |= {
            "loop_gain": 0.0,
            "vertical_loop_gain": 0.0,
            "trim_rate_per_s": TRIM_SHARE * control.trim_rate_per_s,
            "vertical_trim_rate_per_s": TRIM_SHARE * control.vertical_trim_rate_per_s,
        }
    if late_s > RATES_S:
        changes["law"] = _slower(control.law, RATES_S / late_s)
    return control.model_copy(update=changes) if changes else control


def _in_steps(delay_s: Array, before_s: Array) -> Array:
    """(n,) as `fleet_delay_s`, of each link alone; `before_s` (n,) are the results of the tick before."""
    steps_s = np.minimum(MOST_S, STEP_S * np.ceil(delay_s / STEP_S - 1e-6))
    least_s = np.maximum(before_s - STEP_S, LATE_S) - KEPT_S
    kept = (before_s > 0.0) & (least_s < delay_s) & (delay_s <= before_s + KEPT_S)
    return np.where(kept, before_s, np.where(delay_s < LATE_S, 0.0, steps_s))


class LateAmongFast:
    """Responses of vehicles with links that are later than the fleet's delay, of n vehicles.

    One late link among many does not slow the fleet. But its vehicle's inner loop would swing for ever, with
    the neighbours that keep clear of it: it flies with the gains of late links, and its stops begin later.
    """

    def __init__(self, count: int) -> None:
        self._each_s = np.zeros(count)
        self._made: tuple[FleetResponse, ControlSettings, FleetResponse] | None = None

    def response(
        self, usual: FleetResponse, delay_s: Array, flying: Mask, settings: ControlSettings
    ) -> FleetResponse:
        """The response of each vehicle over its link.

        Args:
            usual: over links no later than the fleet's.
            delay_s: (n,) one way, of each link.
            flying: (n,) vehicles that count.
            settings: in force, with the fleet's delay.
        """
        fleet_s = settings.safety.link_delay_s
        flying_s = np.where(flying, delay_s, 0.0)
        if not np.count_nonzero(flying_s > max(fleet_s, LATE_S) - KEPT_S):
            self._each_s[:], self._made = 0.0, None
            return usual
        before_s, self._each_s = self._each_s, _in_steps(flying_s, self._each_s)
        made = self._made
        if made is None or made[:2] != (usual, settings) or (before_s != self._each_s).any():
            self._made = made = usual, settings, _over_own_links(usual, self._each_s, settings)
        return made[2]


def _over_own_links(usual: FleetResponse, each_s: Array, settings: ControlSettings) -> FleetResponse:
    """As `LateAmongFast.response`, by delays (n,) in steps."""
    fleet_s, reaction_s = settings.safety.link_delay_s, settings.safety.braking.reaction_s
    later_s = np.maximum(each_s - fleet_s, 0.0)
    if not np.count_nonzero(later_s):
        return usual
    slowed = (later_s > 0.0) & (each_s > LOOP_S) & (fleet_s <= LOOP_S)
    stops_s = np.maximum(usual.swings_s, reaction_s) + 2.0 * later_s
    return replace(
        usual,
        swings_s=np.where(later_s > 0.0, stops_s, usual.swings_s),
        loop_share=np.where(slowed, 0.0, usual.loop_share),
        trim_share=np.where(slowed, TRIM_SHARE, 1.0) * usual.trim_share,
    )
