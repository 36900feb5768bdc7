"""Where everybody was during a flight: as the service believed, or as a simulation knows."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gcs.errors import GcsError
from gcs.frames import ShowFrame
from gcs.lifecycle import AIRBORNE, FLOWN, Phase
from gcs.records.flown import FlightData
from gcs.state import Array, Landed, Mask, VehicleId

Single = NDArray[np.float32]

IN_THE_AIR: Final = AIRBORNE | {Phase.LOST, Phase.PILOT}
TRUTH_S: Final = 0.05
"""Truth is written that often; several files are brought to common times."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """n vehicles at k times; show frame. What was not known is NaN, and False."""

    based_on: str  # "true positions" or "estimated positions"
    uncertainty: str  # of them, in words
    ids: tuple[VehicleId, ...]
    time_s: Array  # (k,) monotonic clock
    position_m: Single  # (k, n, 3)
    velocity_m_s: Single  # (k, n, 3)
    uncertainty_m: Single  # (k, n) sideways
    airborne: Mask  # (k, n)
    flown: Mask  # (k, n) by the service's setpoints
    formed: Mask  # (k, n) and in the formation, so that the least height counts
    setpoint_m_s: Single | None  # (k, n, 3) NaN: none; None: not known
    remarks: tuple[str, ...]  # about the file


def estimated(data: FlightData) -> Tracks:
    """As the service believed. Raises: GcsError when nothing was recorded."""
    ticks = list(data.ticks())
    if not ticks:
        raise GcsError(f"{data.path}: there is no flight in it. {data.cut}".strip())
    table = np.stack([tick.vehicles for tick in ticks])
    uncertainty_m = table["position_uncertainty_m"]
    phase = _among(data, table, IN_THE_AIR) | ((table["armed"] > 0) & (table["landed"] > Landed.ON_GROUND))
    flown = _among(data, table, FLOWN) & np.isfinite(table["setpoint_x_m_s"])
    widest_m = float(np.nanmax(uncertainty_m[phase], initial=0.0))
    return Tracks(
        "estimated positions",
        f"what the autopilots reported, brought forward to each tick; each may be off by its margin, up to"
        f" {widest_m:.2f} m sideways",
        data.about.ids,
        np.array([tick.tick["time_s"] for tick in ticks]),
        _triples(table, "x", "y", "z"),
        _triples(table, "velocity_x_m_s", "velocity_y_m_s", "velocity_z_m_s"),
        uncertainty_m,
        phase,
        flown,
        flown & _among(data, table, {Phase.FORMATION}),
        _triples(table, "setpoint_x_m_s", "setpoint_y_m_s", "setpoint_z_m_s"),
        (data.cut,) if data.cut else (),
    )


def _among(data: FlightData, table: NDArray[np.void], phases: frozenset[Phase] | set[Phase]) -> Mask:
    numbers = [number for number, phase in enumerate(data.about.phases) if phase in phases]
    among: Mask = np.isin(table["phase"], numbers)
    return among


def _triples(table: NDArray[np.void], *names: str) -> Single:
    return np.stack([table[name] for name in names], axis=-1)


def true(files: Sequence[Path], frame: ShowFrame, beside: Tracks | None, ids: Sequence[VehicleId]) -> Tracks:
    """As a simulation knows, from the files that `gcs sim --truth` writes.

    Args:
        files: each with the same vehicles from beginning to end.
        frame: of the show.
        beside: the same flight as believed, by the same clock, to tell who was flown; None: by the modes.
        ids: names of the vehicles by their numbers, the first has 1; empty: "1", "2" and so on.

    Raises: GcsError naming file and line.
    """
    parts = [_read(file) for file in files]
    start_s, end_s = max(part.time_s[0] for part in parts), min(part.time_s[-1] for part in parts)
    if not start_s < end_s:
        raise GcsError(f"{', '.join(str(file) for file in files)}: they have no time in common")
    time_s = np.arange(start_s, end_s, TRUTH_S)
    numbers = [number for part in parts for number in part.numbers]
    if len(set(numbers)) < len(numbers):
        raise GcsError(f"{', '.join(str(file) for file in files)}: a vehicle is there twice")
    values = np.concatenate([_at(part, time_s) for part in parts], axis=1)
    count, n = values.shape[:2]
    position_m = frame.position_m(*(values[..., axis].ravel() for axis in range(3))).reshape(count, n, 3)
    velocity_m_s = frame.from_ned(values[..., 3:6].reshape(-1, 3)).reshape(count, n, 3)
    names = tuple(ids[number - 1] if number <= len(ids) else str(number) for number in numbers)
    flown = formed = values[..., 7] > 0.5
    setpoint_m_s = None
    if beside is not None and set(names) <= set(beside.ids):
        rows = [beside.ids.index(name) for name in names]
        at = np.clip(np.searchsorted(beside.time_s, time_s, side="right") - 1, 0, len(beside.time_s) - 1)
        during = ((time_s >= beside.time_s[0]) & (time_s <= beside.time_s[-1]))[:, None]
        flown, formed = (mask[at][:, rows] & during for mask in (beside.flown, beside.formed))
        setpoint_m_s = None if beside.setpoint_m_s is None else beside.setpoint_m_s[:, rows]
    else:
        formed = np.zeros_like(flown)
    cut = [
        f"{file}: its last line is cut off" for file, part in zip(files, parts, strict=True) if part.is_cut
    ]
    return Tracks(
        "true positions",
        "the simulation's own states, every 0.05 s and straight between; rounded to 0.1 mm",
        names,
        time_s,
        position_m.astype(np.float32),
        velocity_m_s.astype(np.float32),
        np.zeros((count, n), np.float32),
        values[..., 6] > 0.5,
        flown,
        formed,
        setpoint_m_s,
        tuple(cut),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """One file: k samples of n vehicles, eight values each."""

    numbers: tuple[int, ...]
    time_s: Array  # (k,)
    values: Array  # (k, n, 8) latitude, longitude, altitude, velocity NED, airborne, in OFFBOARD
    is_cut: bool


def _at(part: _Part, time_s: Array) -> Array:
    """(k, n, 8) at other times."""
    flat = part.values.reshape(len(part.time_s), -1)
    columns = [np.interp(time_s, part.time_s, column) for column in flat.T]
    return np.stack(columns, axis=1).reshape(len(time_s), *part.values.shape[1:])


def _read(file: Path) -> _Part:
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise GcsError(f"{file}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise GcsError(f"{file}: not a truth file: not text") from None
    samples, is_cut = [], False
    for number, line in enumerate(lines, start=1):
        try:
            samples.append(_sample(json.loads(line)))
        except (ValueError, KeyError, TypeError) as error:
            is_cut = number == len(lines) and bool(samples)  # of a process that was killed while writing it
            if not is_cut:
                told = f"{type(error).__name__}: {error}"
                raise GcsError(f"{file}, line {number}: not a sample of true states: {told}") from None
    if len(samples) < 2:
        raise GcsError(f"{file}: no true states were written")
    numbers = samples[0][1]
    for number, sample in enumerate(samples, start=1):
        if sample[1] != numbers:
            raise GcsError(f"{file}, line {number}: other vehicles than in line 1")
    time_s = np.array([sample[0] for sample in samples])
    if not (np.diff(time_s) > 0).all():
        raise GcsError(f"{file}: its times do not increase")
    return _Part(numbers, time_s, np.array([sample[2] for sample in samples]), is_cut)


def _sample(raw: Mapping[str, Any]) -> tuple[float, tuple[int, ...], list[list[float]]]:
    """Time, vehicles' numbers, values. Raises: ValueError, KeyError or TypeError for what is none."""
    vehicles = raw["vehicles"]
    place = ("latitude_deg", "longitude_deg", "altitude_amsl_m")
    names = (*place, "velocity_north_m_s", "velocity_east_m_s", "velocity_down_m_s")
    values = [
        [*(float(one[name]) for name in names), float(not one["landed"]), float(one["mode"] == "OFFBOARD")]
        for one in vehicles
    ]
    return float(raw["time_s"]), tuple(int(one["vehicle"]) for one in vehicles), values
