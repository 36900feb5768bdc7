"""Texts of ArduCopter: those of its releases, and the console text at boot, which is no MAVLink (habit 2)."""

from collections.abc import Mapping, Sequence

from gcs.sim.autopilots.firmware import Sent

AT_START = b"\n\nInit ArduCopter V%s (01bdf537)\n\nFree RAM: 131072\n"
WHEN_READY = b"\nReady to FLY  "
READY_AFTER_S = 2.74


class Console:
    """The console text of a fleet's vehicles, until it is sent."""

    def __init__(self, software: str) -> None:
        """`software` is the version's number, as text."""
        self._init = AT_START.replace(b"%s", software.encode("ascii"))
        self._due: dict[int, list[tuple[float, bytes]]] = {}

    def boot(self, row: int, now_s: float) -> None:
        """Begin: the first text comes before the first frame, the second between frames."""
        self._due[row] = [(now_s, self._init), (now_s + READY_AFTER_S, WHEN_READY)]

    def put(self, sent: Sent, now_s: float) -> None:
        """Add the bytes that are due, before the frames of each vehicle."""
        for row in list(self._due):
            texts: Sequence[tuple[float, bytes]] = self._due[row]
            due = [text for due_s, text in texts if due_s <= now_s]
            if due:
                sent[row] = [*due, *sent.get(row, [])]
                self._due[row] = [(due_s, text) for due_s, text in texts if due_s > now_s]
                if not self._due[row]:
                    del self._due[row]


FENCE_NAMES: Mapping[int, str] = {1: "Max Alt", 2: "Circle", 4: "Polygon"}
"""By bit of FENCE_TYPE."""


def breach_text(release: tuple[int, int], breach: int) -> str | None:
    """The text of a fence breach by bits of FENCE_TYPE; until 4.0 there is none."""
    if release < (4, 1):
        return None
    if release < (4, 6):
        return "Fence Breached"
    broken = [name for bit, name in FENCE_NAMES.items() if breach & bit]
    return f"{' and '.join(broken)} fence{'s' if len(broken) > 1 else ''} breached"


def refusal_text(release: tuple[int, int], mode: str, reason: str) -> str:
    """The text of a refused mode."""
    if release < (4, 1):
        return f"Mode change failed: {mode} {reason}"
    return f"Mode change to {mode} failed: {reason}"
