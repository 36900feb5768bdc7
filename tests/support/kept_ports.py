"""Ports of a link that keep what leaves."""

from collections.abc import Callable

import numpy as np

from gcs.links.endpoints.ports import Datagrams, Ports
from gcs.mavlink.kernels import Bytes, Whole
from gcs.model.state import Mask


class KeptPorts(Ports):
    """Keeps what leaves; nothing arrives."""

    def __init__(self) -> None:
        self.left: list[bytes] = []

    def open(self) -> None:
        return

    def close(self) -> None:
        return

    def receive(self, take: Callable[[Datagrams], None]) -> None:
        return

    def send(self, data: Bytes, length: Whole, destination: Whole, *, until_s: float = np.inf) -> Mask:
        self.left += [data[at, : length[at]].tobytes() for at in range(len(length))]
        return np.ones(len(length), np.bool_)
