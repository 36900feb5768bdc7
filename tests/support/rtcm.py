"""RTCM 3 messages for tests: right in length and checksum."""

from typing import Final

from pyrtcm import crc2bytes, llh2ecef

BASE: Final = (47.3977, 8.5456, 512.25)
"""Latitude and longitude in degrees, height above the ellipsoid in m."""


def rtcm(kind: int, size: int) -> bytes:
    """A message of `size` bytes in all, at least 8, with a payload without meaning."""
    payload = (kind << 4).to_bytes(2, "big") + bytes(at * 37 % 251 for at in range(size - 8))
    head = b"\xd3" + len(payload).to_bytes(2, "big") + payload
    return head + bytes(crc2bytes(head))


def base_message() -> bytes:
    """A 1005 of a base at `BASE`: places in 0.1 mm, as 38 bits with sign."""
    x, y, z = (round(each * 1e4) & (1 << 38) - 1 for each in llh2ecef(*BASE))
    bits = f"{1005:012b}{7:012b}{0:06b}1110{x:038b}00{y:038b}00{z:038b}"
    payload = int(bits, 2).to_bytes(19, "big")
    head = b"\xd3" + len(payload).to_bytes(2, "big") + payload
    return head + bytes(crc2bytes(head))
