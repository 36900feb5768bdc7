"""Parsers of the command line's values; wrong values are refused with the allowed form."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

from gcs.sim.fleet import Origin
from gcs.sim.vehicle.params import ParameterError, Parameters, Value, defaults
from gcs.sim.vehicle.quirks import QuirkError, Quirks

if TYPE_CHECKING:
    from collections.abc import Callable


def whole(low: int, high: int) -> Callable[[str], int]:
    """A parser of whole numbers from low to high."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = low - 1
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from {low} to {high}")
        return value

    return parse


def number(low: float, high: float) -> Callable[[str], float]:
    """A parser of numbers from low to high."""

    def parse(text: str) -> float:
        value = _float(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is not a number from {low:g} to {high:g}")
        return value

    return parse


def _float(text: str) -> float:
    """The number, or NaN, which is inside no range."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def triple(form: str) -> Callable[[str], tuple[float, float, float]]:
    """A parser of three numbers with commas between them."""

    def parse(text: str) -> tuple[float, float, float]:
        north, east, down = _numbers(text, form, 3)
        return north, east, down

    return parse


def pair(form: str) -> Callable[[str], tuple[float, float]]:
    """A parser of two numbers with a comma between them."""

    def parse(text: str) -> tuple[float, float]:
        north, east = _numbers(text, form, 2)
        return north, east

    return parse


def _numbers(text: str, form: str, count: int) -> list[float]:
    """Parse `count` finite numbers. Raises: ArgumentTypeError."""
    values = [_float(part) for part in text.split(",")]
    if len(values) != count or not all(map(math.isfinite, values)):
        words = {2: "two numbers with a comma", 3: "three numbers with commas"}[count]
        raise argparse.ArgumentTypeError(f"{text!r} is not {form}: {words} between them")
    return values


def origin(text: str) -> Origin:
    """Parse LAT,LON,ALT."""
    latitude_deg, longitude_deg, altitude_amsl_m = triple("LAT,LON,ALT")(text)
    if not (abs(latitude_deg) <= 90 and abs(longitude_deg) <= 180):
        raise argparse.ArgumentTypeError(
            f"{text!r}: latitude goes from -90 to 90, longitude from -180 to 180 degrees"
        )
    return Origin(latitude_deg, longitude_deg, altitude_amsl_m)


def parameter(text: str) -> tuple[str, Value]:
    """Parse NAME=VALUE of a PX4 parameter."""
    name, separator, value_text = text.partition("=")
    value = _float(value_text)
    if not separator or not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=VALUE, as in COM_OBL_RC_ACT=5")
    try:
        Parameters({name: value})
    except ParameterError as error:
        near = [known for known in defaults() if known.startswith(name.split("_")[0] + "_")][:5]
        hint = f"; there are {', '.join(near)} ..." if near and name not in defaults() else ""
        raise argparse.ArgumentTypeError(f"{error}{hint}") from None
    return name, value


def quirk(text: str) -> tuple[str, bool]:
    """Parse NAME=on or NAME=off."""
    name, _, switch = text.partition("=")
    if switch not in {"on", "off"}:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=on or NAME=off, as in double-ack=off")
    try:
        Quirks().changed([(name, True)])
    except QuirkError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return name, switch == "on"
