"""What the status texts of autopilots mean: patterns by autopilot and by the versions that send them.

Pure data. PX4 1.14 to 1.18 and ArduCopter 4.0 to 4.7, from their sources. A text is of the first row that
matches it, whichever version sends it: an unknown version is read as well as a known one. The rows of ANY are
words that newer texts are likely to have.
"""

import re
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from typing import Final


class Meaning(StrEnum):
    """What a text is about."""

    TERMINATION = "termination"
    CRITICAL_BATTERY = "critical-battery"
    LOW_BATTERY = "low-battery"
    GEOFENCE = "geofence"
    POSITION_LOSS = "position-loss"
    DATA_LINK_LOSS = "data-link-loss"
    RC_LOSS = "rc-loss"
    PILOT = "pilot"  # a pilot has moved the sticks
    LAND_NOW = "land-now"  # the autopilot asks its operator to land, and does not do so itself
    LINK_BACK = "link-back"  # heartbeats are received again, and the mode of the failsafe stays
    REFUSED = "refused"  # it answers a command: it explains no failsafe
    OVER = "over"  # a failsafe or a warning has ended
    HOLDS_FIRST = "holds-first"  # a failsafe acts within seconds, and holds until then
    UNSAID = "unsaid"  # a failsafe acts, of a cause that is not said
    NOTHING = "nothing"  # none of these


@dataclass(frozen=True, slots=True)
class TextRow:
    """Texts of one meaning."""

    autopilot: str  # as in configurations; ANY: of all
    versions: str  # the first and the last that send it; empty: not known
    meaning: Meaning
    words: re.Pattern[str]  # somewhere in the text in lower case


ANY: Final = "any"
PX4, ARDUPILOT = "px4", "ardupilot"

M = Meaning

TEXTS: Final = tuple(
    TextRow(autopilot, versions, meaning, re.compile(words))
    for autopilot, versions, meaning, words in (
        # answers to commands first: they name modes, fences and failsafes
        (PX4, "1.14-1.18", M.REFUSED, r"preflight fail|denied|not available|landing at current position"),
        (ARDUPILOT, "4.0-4.0", M.REFUSED, r"mode change failed"),
        (ARDUPILOT, "4.1-4.7", M.REFUSED, r"mode change to .* failed"),
        (ARDUPILOT, "4.0-4.7", M.REFUSED, r"(pre)?arm: "),
        (PX4, "1.14-1.18", M.LAND_NOW, r"\bland now\b"),
        (ARDUPILOT, "4.0-4.7", M.LINK_BACK, r"gcs failsafe cleared"),
        (ARDUPILOT, "4.0-4.7", M.OVER, r"failsafe cleared|glitch cleared|fence breach cleared"),
        (ARDUPILOT, "4.3-4.7", M.OVER, r"dead reckoning stopped"),
        (PX4, "1.14-1.18", M.OVER, r"\bregained\b"),
        (ARDUPILOT, "4.6-4.7", M.NOTHING, r"fences? in [\d.]+ ?m"),  # a margin, not a breach
        (PX4, "1.14-1.18", M.TERMINATION, r"flight terminat|terminating flight"),
        (ARDUPILOT, "4.0-4.7", M.TERMINATION, r"\bterminating due to\b"),
        (PX4, "1.14-1.18", M.PILOT, r"pilot took over"),
        (PX4, "1.14-1.18", M.CRITICAL_BATTERY, r"(critical|emergency|dangerous\w*)\b.*\bbattery"),
        (PX4, "1.14-1.18", M.CRITICAL_BATTERY, r"battery \d+ (missing|disconnected)"),
        (ARDUPILOT, "4.0-4.7", M.CRITICAL_BATTERY, r"battery \d+ is critical"),
        (PX4, "1.14-1.18", M.LOW_BATTERY, r"low battery|flight time low"),
        (ARDUPILOT, "4.0-4.7", M.LOW_BATTERY, r"battery (\d+ is low|failsafe)"),
        (PX4, "1.14-1.14", M.GEOFENCE, r"maximum (distance from|altitude above) home reached"),
        (PX4, "1.15-1.18", M.GEOFENCE, r"geofence"),
        (ARDUPILOT, "4.1-4.7", M.GEOFENCE, r"fences? breached"),
        (ARDUPILOT, "4.0-4.7", M.POSITION_LOSS, r"ekf variance|ekf failsafe"),
        (ARDUPILOT, "4.3-4.7", M.POSITION_LOSS, r"gps glitch|dead reckoning (started|timeout)"),
        (PX4, "1.14-1.18", M.POSITION_LOSS, r"\bno (valid )?((local|global) )?position"),
        (
            ANY,
            "",
            M.POSITION_LOSS,
            (
                r"(position|velocity|navigation|attitude|gps|gnss|ekf|estimat\w*)\b.*"
                r"(lost|loss|invalid|fail|unreliable|jam|spoof|timeout|variance)"
            ),
        ),
        (PX4, "1.14-1.18", M.DATA_LINK_LOSS, r"no connection to the (gcs|ground control station)"),
        (ARDUPILOT, "4.0-4.7", M.DATA_LINK_LOSS, r"gcs failsafe"),
        (ANY, "", M.DATA_LINK_LOSS, r"(gcs|data ?link|ground (control )?station).*\blost"),
        (ARDUPILOT, "4.0-4.7", M.RC_LOSS, r"radio failsafe"),
        (ANY, "", M.RC_LOSS, r"(\brc\b|manual control|radio control).*\b(lost|loss)"),
        (PX4, "1.14-1.18", M.HOLDS_FIRST, r"failsafe activated.*entering hold"),
        (PX4, "1.14-1.18", M.UNSAID, r"failsafe activated"),
    )
)
"""Most specific first."""


@lru_cache(maxsize=4096)
def meaning_of(text: str) -> Meaning:
    """Return what a status text is about."""
    lower = text.lower()
    return next((row.meaning for row in TEXTS if row.words.search(lower)), Meaning.NOTHING)
