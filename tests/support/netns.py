"""Network namespaces for tests of several hosts, and whether there can be some here."""

import ctypes
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final, TypeVar

T = TypeVar("T")

GET_THEM: Final = "run as root, with `ip`: sudo apt-get install -y iproute2"

NOT_RUN: Final = f"Tests of several hosts were not run: they need network namespaces. To get them: {GET_THEM}"

REQUIRED: Final = "REQUIRE_NETNS"
"""In the environment, 1: to have none is an error."""

_CLONE_NEWNET: Final = 0x40000000


def are_possible() -> bool:
    """Whether this user can make network namespaces."""
    return os.geteuid() == 0 and shutil.which("ip") is not None


def is_required() -> bool:
    """Whether the environment demands network namespaces."""
    return os.environ.get(REQUIRED, "") not in {"", "0"}


def enter(namespace: str) -> None:
    """Let sockets that this thread opens belong to that namespace. Raises: OSError."""
    libc = ctypes.CDLL(None, use_errno=True)
    handle = os.open(Path("/run/netns") / namespace, os.O_RDONLY)
    try:
        if libc.setns(handle, _CLONE_NEWNET):
            number = ctypes.get_errno()
            raise OSError(number, f"namespace {namespace}: {os.strerror(number)}")
    finally:
        os.close(handle)


class Inside:
    """A thread inside a namespace: what it opens belongs there."""

    def __init__(self, namespace: str) -> None:
        """Enters with the first call."""
        self._threads = ThreadPoolExecutor(1, initializer=enter, initargs=(namespace,))

    def __call__(self, function: Callable[[], T], /) -> T:
        return self._threads.submit(function).result()

    def end(self) -> None:
        self._threads.shutdown()


class Hosts:
    """Hosts on two switches that one cable joins. Each host has loopback and an address in 10.77.0.0/24.

    The switches have a namespace of their own: nothing of it is seen outside.
    """

    def __init__(self, tag: str, left: Sequence[str], right: Sequence[str]) -> None:
        """`tag` is part of every namespace's name."""
        self._tag, self._sides = tag, (tuple(left), tuple(right))
        self.names = (*left, *right)
        self.addresses = {name: f"10.77.0.{number}" for number, name in enumerate(self.names, 1)}

    def namespace(self, name: str) -> str:
        """Of a host, or of the "switches"."""
        return f"gcs-{self._tag}-{name}"

    def make(self) -> None:
        net = self.namespace("switches")
        _ip(f"netns add {net}", *(f"netns add {self.namespace(name)}" for name in self.names))
        lines = [f"link add cable0 netns {net} type veth peer name cable1 netns {net}"]
        _ip(*lines)
        for side, names in enumerate(self._sides):
            lines = [f"link add switch{side} type bridge", f"link set switch{side} up"]
            lines += [f"link set cable{side} master switch{side}", f"link set cable{side} up"]
            for name in names:
                host = self.namespace(name)
                _ip(f"link add {name} netns {net} type veth peer name eth0 netns {host}")
                lines += [f"link set {name} master switch{side}", f"link set {name} up"]
                own = ["link set lo up", f"addr add {self.addresses[name]}/24 dev eth0", "link set eth0 up"]
                _ip(*own, namespace=host)
            _ip(*lines, namespace=net)

    def cut(self) -> None:
        """Pull the cable between the two switches."""
        _ip("link set cable0 down", namespace=self.namespace("switches"))

    def heal(self) -> None:
        """Plug the cable in again."""
        _ip("link set cable0 up", namespace=self.namespace("switches"))

    def remove(self) -> None:
        """With all that is in them; what was not made is skipped."""
        for name in ("switches", *self.names):
            if (Path("/run/netns") / self.namespace(name)).exists():
                _ip(f"netns del {self.namespace(name)}")


def _ip(*lines: str, namespace: str | None = None) -> None:
    """Run these commands of `ip`. Raises: CalledProcessError."""
    words = [] if namespace is None else ["-n", namespace]
    text = "\n".join(lines)
    subprocess.run(["ip", *words, "-batch", "-"], input=text, text=True, check=True)  # noqa: S607 - the user's ip


@contextmanager
def hosts(tag: str, left: Sequence[str], right: Sequence[str]) -> Iterator[Hosts]:
    """Have hosts until the block ends."""
    made = Hosts(tag, left, right)
    with ExitStack() as stack:
        stack.callback(made.remove)
        made.make()
        yield made


if __name__ == "__main__" and not are_possible():
    sys.stdout.write(f"{NOT_RUN}\n")
