"""Which signs of life of a vehicle are missing, and the consequence. Pure; decision 0024.

Every message of a vehicle's autopilot is a sign of life. Its position is needed to fly it, its heartbeat to
know its mode: a pilot's takeover shows nowhere else.

- No telemetry at all, or no position: the vehicle is lost, and nothing is sent to it.
- No heartbeat, but positions: it is flown on. Setpoints take nothing from a pilot, for PX4 follows them in
  OFFBOARD only. An alarm names the missing heartbeats. Without a fresh heartbeat the service sends no mode
  change on its own. After BEATS_LACK_MAX_S more the vehicle counts as lost: a pilot may have
  flown it for so long that the others must not rely on its giving way.
"""

from math import isfinite
from typing import Final

BEATS_MAY_LACK_S: Final = 1.5
"""Heartbeats come once a second: a single missing one means nothing. A vehicle on the ground is offline after
`operation.silence_s` and this, and one in the air is reported.
"""

BEATS_LACK_MAX_S: Final = 8.0
"""A vehicle in the air is lost after `operation.silence_s` and this. Where a fifth of all messages is lost,
ten heartbeats in a row are lost once in ten million.
"""


ARRIVES_S: Final = 1.0
"""An autopilot sends several messages a second: when the newest is older, none arrives."""


def lacking(now_s: float, life_s: float, beat_s: float, position_s: float, silence_s: float) -> str:
    """What is missing of a vehicle's telemetry, in words; empty when nothing is.

    Args:
        now_s: of this tick.
        life_s: arrival of any message from its autopilot, -inf before the first.
        beat_s: of its newest heartbeat.
        position_s: of its newest position.
        silence_s: `operation.silence_s`.
    """
    if not now_s - life_s <= silence_s:
        return f"no telemetry{_since(now_s - life_s)}"
    if not now_s - position_s <= silence_s:
        if now_s - life_s > ARRIVES_S:
            return f"no telemetry{_since(now_s - life_s)}"
        beats = now_s - beat_s <= silence_s
        others = "heartbeats still arrive" if beats else "other telemetry still arrives"
        return f"no position{_since(now_s - position_s)}, {others}"
    if not now_s - beat_s <= silence_s + BEATS_MAY_LACK_S:
        return f"no heartbeat{_since(now_s - beat_s)}, positions still arrive"
    return ""


def _since(age_s: float) -> str:
    return f" for {age_s:.1f} s" if isfinite(age_s) else ""
