"""A radio with many vehicles behind one address and several frames in a datagram, in its own thread."""

import selectors
import socket
import threading
from types import TracebackType
from typing import Self

from gcs.mavlink.codec import split, target_system
from gcs.mavlink.framing import HEARTBEAT

_DATAGRAM_BYTES = 1400


class Router:
    """Vehicles send to `port`; the ground station receives from one address only.

    Attributes:
        broadcasts: how many frames without a target came from the ground.
        drops_heartbeats: whether the heartbeats of the ground are lost.
    """

    def __init__(self, ground_port: int) -> None:
        self.broadcasts = 0
        self.drops_heartbeats = False
        self._ground = ("127.0.0.1", ground_port)
        self._inner = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._outer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._inner.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        for each in (self._inner, self._outer):
            each.bind(("127.0.0.1", 0))
            each.setblocking(False)
        self._vehicles: dict[int, tuple[str, int]] = {}
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._live, name="router")
        self._thread.start()

    @property
    def port(self) -> int:
        port: int = self._inner.getsockname()[1]
        return port

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stopped.set()
        self._thread.join()
        self._inner.close()
        self._outer.close()

    def _live(self) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(self._inner, selectors.EVENT_READ)
            selector.register(self._outer, selectors.EVENT_READ)
            while not self._stopped.wait(0.005):  # so that several frames are there
                selector.select(0.01)
                self._up()
                self._down()

    def _up(self) -> None:
        waiting = b""
        while True:
            try:
                data, sender = self._inner.recvfrom(2048)
            except BlockingIOError:
                break
            for frame in split(data).frames:
                self._vehicles[frame.system_id] = sender
            if len(waiting) + len(data) > _DATAGRAM_BYTES:
                self._outer.sendto(waiting, self._ground)
                waiting = b""
            waiting += data
        if waiting:
            self._outer.sendto(waiting, self._ground)

    def _down(self) -> None:
        while True:
            try:
                data = self._outer.recv(2048)
            except (BlockingIOError, ConnectionRefusedError):
                return
            for frame in split(data).frames:
                if self.drops_heartbeats and frame.message_id == HEARTBEAT:
                    continue
                target = target_system(frame)
                self.broadcasts += target == 0
                known = tuple(self._vehicles.items())
                for address in {at for system_id, at in known if target in (0, system_id)}:
                    self._inner.sendto(frame.raw, address)
