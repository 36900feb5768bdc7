"""Our end of one MAVSDK instance's connection: a UDP port on this machine, which nobody else may speak to."""

import socket
from collections.abc import Iterator
from typing import Final

from gcs.errors import LinkError
from gcs.links.mmsg import Batch

_HOST: Final = "127.0.0.1"
_LONGEST_BYTES: Final = 2048
_READS_PER_CALL: Final = 4096
_BUFFER_BYTES: Final = 4 << 20
_GREETING_S: Final = 5.0
_ERRORS: Final = 16


class Loopback:
    """One UDP socket. MAVSDK writes to it without Python: its threads and ours never wait for each other."""

    def __init__(self, name: str) -> None:
        """Bound, to a port that the system picks. Raises: LinkError. `name` is for errors."""
        self._name = name
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
            self._socket.bind((_HOST, 0))
        except OSError as error:
            self._socket.close()
            raise LinkError(f"{name}: a UDP port on {_HOST}: {error}") from error

    @property
    def url(self) -> str:
        """What MAVSDK is to connect to."""
        return f"udpout://{_HOST}:{self._socket.getsockname()[1]}"

    def meet(self) -> None:
        """Wait for MAVSDK's first heartbeat, and hear nobody else from then on. Raises: LinkError."""
        self._socket.settimeout(_GREETING_S)
        try:
            _, sender = self._socket.recvfrom(_LONGEST_BYTES)
            self._socket.connect(sender)
        except OSError as error:
            raise LinkError(f"{self._name}: MAVSDK does not speak: {error}") from error
        self._socket.setblocking(False)

    def give(self, data: bytes) -> bool:
        """Hand over one datagram of frames; False when there is no room for it, or nobody."""
        try:
            self._socket.send(data)
        except OSError:
            return False
        return True

    def take_batch(self, room: Batch) -> int:
        """Fill `room` with what MAVSDK has written since. Returns: how many datagrams. Never blocks."""
        for _ in range(_ERRORS):
            try:
                return room.receive(self._socket.fileno(), 0, len(room.length))
            except BlockingIOError:
                return 0
            except OSError:  # of an earlier send: it was just not there
                continue
        return 0

    def take(self) -> Iterator[bytes]:
        """The same where the platform has no batches, one by one."""
        receive = self._socket.recv
        for _ in range(_READS_PER_CALL):
            try:
                yield receive(_LONGEST_BYTES)
            except BlockingIOError:
                return
            except OSError:  # of an earlier send: it was just not there
                continue

    def close(self) -> None:
        """Release the port."""
        self._socket.close()
