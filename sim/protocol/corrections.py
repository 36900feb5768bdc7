"""Reassembly of GPS_RTCM_DATA, as PX4 does: fragments of one sequence, in any order. Sans-I/O."""

FRAGMENT_BYTES = 180
FRAGMENTS_MAX = 4
RTCM_PREAMBLE = b"\xd3"


class Reassembly:
    """Fragments of one message; those of another sequence begin anew."""

    def __init__(self) -> None:
        self._sequence = -1
        self._parts: dict[int, bytes] = {}

    def take(self, flags: int, data: bytes) -> bytes | None:
        """The whole message that this fragment completes, else None."""
        if not flags & 1:
            return data
        sequence, number = flags >> 3, flags >> 1 & 3
        if sequence != self._sequence or number in self._parts:
            self._sequence, self._parts = sequence, {}
        self._parts[number] = data
        whole = b""
        for at in range(FRAGMENTS_MAX):
            part = self._parts.get(at)
            if part is None:
                return None
            whole += part
            if len(part) < FRAGMENT_BYTES:
                break
        self._parts = {}
        return whole
