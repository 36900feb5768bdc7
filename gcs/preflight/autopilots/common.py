"""What every autopilot must have, under whatever name. Pure."""

from math import atan, ceil, degrees
from typing import Final

from gcs.config.sections import OperationSettings
from gcs.control import ControlSettings
from gcs.preflight.vehicles import PAD_HEIGHT_MAX_M

GRAVITY_M_S2: Final = 9.80665
TILT_RESERVE: Final = 2.0
"""Multiple of the commanded acceleration: the rest is for wind and drag."""

WIDEST: Final = 2.0
"""A fence farther away than this multiple of the needed distance protects nothing."""


def least_tilt_deg(control: ControlSettings) -> float:
    return float(ceil(degrees(atan(TILT_RESERVE * control.acceleration_max_m_s2 / GRAVITY_M_S2))))


def own_fence_m(operation: OperationSettings, control: ControlSettings, on_s: float) -> tuple[float, float]:
    """Least radius and height of the autopilot's own fence; `on_s`: how long it flies on at the fastest.

    It is a cylinder round each vehicle's own home, where it was armed; the service's fence is centred on the
    show's origin. A vehicle at the service's fence, opposite its pad, is farther from home by the distance of
    its pad from the origin. It may also overshoot by the distance it flies until it has noticed and stopped.
    """
    fence, limits, pads_m = control.safety.fence, control.safety.limits, operation.pads_within_m
    wide_m = float(ceil(fence.distance_max_m + pads_m + limits.horizontal_m_s * on_s))
    highest_m = max(fence.height_max_m, operation.return_height_m)
    return wide_m, float(ceil(highest_m + PAD_HEIGHT_MAX_M + limits.up_m_s * on_s))


def highest_wall_m(tall_m: float, top_m: float) -> float:
    """Greatest height of its own fence, which must be `tall_m`: no higher than the volume up to `top_m`."""
    return max(tall_m, min(WIDEST * tall_m, top_m))


def own_fence_reasons(operation: OperationSettings) -> tuple[str, str]:
    """Why its radius, and its height, must not be less."""
    wall, pads_m = "from its own start: the service's fence, and room for", operation.pads_within_m
    far = f"{wall} pads {pads_m:g} m from the origin (operation.pads_within_m) and its stop"
    return far, f"{wall} pads {PAD_HEIGHT_MAX_M:g} m below the origin and its stop"
