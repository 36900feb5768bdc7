"""The protocol of all profiles, and what a profile has a transport send."""

from collections.abc import Mapping
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.links.autopilots.fence_habits import FenceHabits
from gcs.links.autopilots.versions import Versions
from gcs.links.link import Command, ParameterValue, Verb
from gcs.mavlink.kernels import Whole
from gcs.model.response import Response
from gcs.model.setpoint_loss import WithoutSetpoints
from gcs.model.state import Landed, Mask, Mode


class CommandLong(NamedTuple):
    """A COMMAND_LONG: its number, and its parameters from the first on; the others are 0."""

    command: int
    params: tuple[float, ...]


class SetParameter(NamedTuple):
    """A PARAM_SET."""

    name: str
    value: ParameterValue


Step: TypeAlias = CommandLong | SetParameter

Single: TypeAlias = NDArray[np.float32]
"""(1,) the field `param_value`; an array, because a number would lose the bits of a NaN."""


class Autopilot(Protocol):
    """One kind of autopilot."""

    @property
    def name(self) -> str:
        """In configurations."""

    @property
    def title(self) -> str:
        """In texts for operators."""

    @property
    def number(self) -> int:
        """MAV_AUTOPILOT, as its HEARTBEAT reports it."""

    @property
    def component_parameter(self) -> str:
        """The parameter that has its component id; empty: that cannot be changed."""

    @property
    def versions(self) -> Versions:
        """What is known of its versions."""

    @property
    def modes(self) -> Mapping[Verb, frozenset[Mode]]:
        """Modes that a command explains once it is executed; none of commands that do not change it."""

    @property
    def takeoff_ends_with_setpoints(self) -> bool:
        """Whether a setpoint during its own take-off ends the climb."""

    @property
    def stops_on_setpoint_only(self) -> bool:
        """Whether it flies on for seconds after its last setpoint, so that the last one is to be at rest."""

    @property
    def health_by_mavsdk(self) -> bool:
        """Whether MAVSDK's `health_all_ok` can become true."""

    @property
    def falls_on_ground(self) -> bool:
        """Whether it reports ON_GROUND as soon as its motors are stopped, at any height."""

    @property
    def complains(self) -> tuple[str, float]:
        """How texts begin that say why it would not arm, and how long each counts if not repeated, in s."""

    @property
    def fence(self) -> FenceHabits:
        """How it keeps an uploaded fence."""

    def mode(self, custom_mode: int) -> Mode:
        """The mode of a HEARTBEAT; OTHER for modes that are never commanded."""

    def steps(self, command: Command) -> tuple[Step, ...]:
        """What executes a command; each step is acknowledged before the next is sent. Not of KILL."""

    def rests_in(self, mode: Mode) -> bool:
        """Whether a disarmed vehicle may stay in this mode: it passes its own checks in it."""

    def climb_ended(self, mode: Mode, landed: Landed, up_m_s: float) -> bool:
        """Whether its own take-off has ended, whatever height it has reached; `up_m_s` is measured."""

    def ready(self, custom_mode: Whole, estimator_flags: Whole) -> Mask:
        """Whether a passed pre-arm check means that it can be armed and flown.

        Args:
            custom_mode: (n,) of HEARTBEAT.
            estimator_flags: (n,) of EKF_STATUS_REPORT, -1: none received.

        Returns: (n,).
        """

    def beyond_fence(self, unhealthy_sensors: int) -> bool:
        """Whether it reports by this that its own fence is breached.

        Args:
            unhealthy_sensors: bits of MAV_SYS_STATUS_SENSOR in use and unhealthy, -1: not reported.
        """

    def without_setpoints(
        self, action: str, loss_s: float, parameters: Mapping[str, ParameterValue]
    ) -> WithoutSetpoints:
        """What it does when setpoints end.

        Args:
            action: `operation.setpoint_loss_action`.
            loss_s: `operation.setpoint_loss_s`.
            parameters: as far as known.
        """

    def response(self, parameters: Mapping[str, ParameterValue]) -> Response:
        """How it answers setpoints; `parameters` as far as known."""

    def streams_hz(self, desired_hz: Mapping[int, float]) -> Mapping[int, float]:
        """Rates to request, by message id: the desired ones that it knows, and those that it needs itself."""

    def encoded(self, value: ParameterValue) -> tuple[Single, int]:
        """`param_value` and `param_type` of a PARAM_SET."""

    def decoded(self, value: Single, kind: int) -> ParameterValue:
        """The value of a PARAM_VALUE; `kind` is its MAV_PARAM_TYPE."""
