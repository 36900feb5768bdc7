"""Version of an autopilot, as AUTOPILOT_VERSION reports it."""

from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, NamedTuple

RELEASED: Final = 255
_KINDS: Final = MappingProxyType({0: "-dev", 64: "-alpha", 128: "-beta", 192: "-rc", RELEASED: ""})
"""By FIRMWARE_VERSION_TYPE."""


class Release(NamedTuple):
    """A major and minor number. Patches change neither names nor meanings of parameters."""

    major: int
    minor: int

    @staticmethod
    def parse(text: str) -> "Release":
        """Read "1.16". Raises: ValueError."""
        major, minor = text.split(".")
        return Release(int(major), int(minor))

    def __str__(self) -> str:
        return f"{self.major}.{self.minor}"


@dataclass(frozen=True, slots=True)
class Version:
    """A version with its patch, and how near to a release it is."""

    release: Release
    patch: int
    kind: int  # FIRMWARE_VERSION_TYPE

    @staticmethod
    def of(flight_sw_version: int) -> "Version | None":
        """None for 0: the vehicle has not reported its version, or does not know it."""
        return Version.decoded(flight_sw_version) if flight_sw_version else None

    @staticmethod
    def decoded(flight_sw_version: int) -> "Version":
        major, minor, patch, kind = flight_sw_version.to_bytes(4, "big")
        return Version(Release(major, minor), patch, kind)

    @property
    def is_released(self) -> bool:
        """Whether it is complete: a development build of 4.1 may have any part of what 4.1 changes."""
        return self.kind == RELEASED

    def __str__(self) -> str:
        return f"{self.release}.{self.patch}{_KINDS.get(self.kind, '-custom')}"
