"""Our end of one MAVSDK instance's connection: a UDP port on this machine, connected to MAVSDK only."""

import socket
from typing import Final

from gcs.links import mmsg
from gcs.model.errors import LinkError

_HOST: Final = "127.0.0.1"
_LONGEST_BYTES: Final = 2048
_BUFFER_BYTES: Final = 4 << 20
_GREETING_S: Final = 5.0
_ERRORS: Final = 16


class Loopback:
    """One UDP socket. MAVSDK writes to it without Python: its threads and ours never wait for each other."""

    def __init__(self, name: str) -> None:
        """Bind to a port that the system picks. Raises: LinkError. `name` is for errors."""
        self._name = name
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
            self._socket.bind((_HOST, 0))
        except OSError as error:
            self._socket.close()
            raise LinkError(f"{name}: a UDP port on {_HOST}: {error}") from error

    @property
    def fd(self) -> int:
        """File descriptor of the socket, to wait for."""
        return self._socket.fileno()

    @property
    def url(self) -> str:
        """URL to which MAVSDK connects."""
        return f"udpout://{_HOST}:{self._socket.getsockname()[1]}"

    def meet(self) -> None:
        """Wait for MAVSDK's first heartbeat, and accept no other sender from then on. Raises: LinkError."""
        self._socket.settimeout(_GREETING_S)
        try:
            _, sender = self._socket.recvfrom(_LONGEST_BYTES)
            self._socket.connect(sender)
        except OSError as error:
            raise LinkError(f"{self._name}: MAVSDK does not speak: {error}") from error
        self._socket.setblocking(False)

    def give(self, data: bytes) -> bool:
        """Send one datagram of frames; False when there is no room or no receiver."""
        try:
            self._socket.send(data)
        except OSError:
            return False
        return True

    def take(self, room: mmsg.Batch, first: int = 0) -> int:
        """Fill `room` from row `first` on with what MAVSDK has written since. Never blocks.

        Returns: number of datagrams.
        """
        most = len(room.length) - first
        for _ in range(_ERRORS):
            try:
                if mmsg.available():
                    return room.receive(self._socket.fileno(), first, most)
                return self._take_singly(room, first, most)
            except BlockingIOError:
                return 0
            except OSError:  # of an earlier send: MAVSDK was not there
                continue
        return 0

    def _take_singly(self, room: mmsg.Batch, first: int, most: int) -> int:
        """For platforms without batches."""
        for row in range(first, first + most):
            try:
                room.length[row] = self._socket.recv_into(memoryview(room.data[row]))
            except BlockingIOError:
                return row - first
        return most

    def close(self) -> None:
        """Release the port."""
        self._socket.close()
