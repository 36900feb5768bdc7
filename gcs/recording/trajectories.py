"""Trajectories of all vehicles of a flight: as estimated, or as a simulation knows them."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gcs.model.errors import GcsError
from gcs.model.frames import ShowFrame
from gcs.model.lifecycle import AIRBORNE, FLOWN, Phase
from gcs.model.state import Array, Landed, Mask, VehicleId
from gcs.recording import mcap_layout as layout
from gcs.recording.mcap_layout import RecordedLimits
from gcs.recording.mcap_reader import FlightData, RecordedSample
from gcs.recording.target_tracking import target_tracking
from gcs.recording.traffic_passed import traffic_passed
from gcs.service.snapshots import TargetTracking, TrackPassed

Single = NDArray[np.float32]
OnProgress = Callable[[float], None]
REPORTED_TICKS: Final = 50
"""Number of ticks between two progress reports."""

IN_THE_AIR: Final = AIRBORNE | {Phase.LOST, Phase.PILOT}
TRUTH_S: Final = 0.05
"""Interval of true positions in their files; several files are resampled to common times."""


@dataclass(frozen=True, slots=True, eq=False)
class FlownTrajectories:
    """n vehicles at k times; show frame. Unknown values are NaN, and False."""

    based_on: str  # "true positions" or "estimated positions"
    uncertainty: str  # of the positions, in words
    ids: tuple[VehicleId, ...]
    time_s: Array  # (k,) monotonic clock
    position_m: Single  # (k, n, 3)
    velocity_m_s: Single  # (k, n, 3)
    uncertainty_m: Single  # (k, n) sideways
    airborne: Mask  # (k, n)
    flown: Mask  # (k, n) under the service's setpoints
    formed: Mask  # (k, n) in formation as well, so that the least height counts
    recent: Mask  # (k, n) the position is at most RECENT_S old, so that its change is the vehicle's
    setpoint_m_s: Single | None  # (k, n, 3) NaN: none; None: not known
    remarks: tuple[str, ...]  # about the file
    missing: tuple[str, ...] = ()  # parts of the flight that are missing, in words
    held: tuple[RecordedLimits | None, ...] = (None,)  # limits as recorded; None: not recorded
    held_at: NDArray[np.intp] | None = None  # (k,) index of the limits; None: always the first
    setpoint_held_at: NDArray[np.intp] | None = None  # (j,) likewise, at the setpoints' own times
    autopilots: tuple[str, ...] = ()  # (n,) names; empty: not known
    tracking: tuple[TargetTracking, ...] = ()  # by the estimates of vehicles and targets
    traffic: tuple[TrackPassed, ...] = ()  # likewise
    site_hash: str = ""  # of the site's areas; empty: there were none
    show_hashes: tuple[str, ...] = ()  # of the written shows that were selected in the air, in order
    wind_m_s: float | None = None  # greatest that was measured, with gusts; None: none was

    def elapsed_s(self, sample: int | np.signedinteger[Any]) -> float:
        """Time of a sample since the first, to hundredths of a second."""
        return round(float(self.time_s[sample] - self.time_s[0]), 2)


UNKNOWN: Final = dict.fromkeys(("position_m", "velocity_m_s", "setpoint_m_s"), np.nan) | {
    "uncertainty_m": 0.0,
    **dict.fromkeys(("airborne", "flown", "formed", "recent"), False),
}
"""Values of an unknown sample in `Trajectories`."""

RECENT_S: Final = 0.25
"""An older position was brought forward so far that the next to arrive may look like an acceleration."""

GAPS_REPORTED: Final = 20
GAP_S: Final = 1.0
"""Between two samples farther apart than this the path is unknown."""


def estimated(data: FlightData, on_progress: OnProgress | None = None) -> FlownTrajectories:
    """Read estimated trajectories. `on_progress` is called with the share that is read, from 0 to 1.

    Raises: GcsError when nothing was recorded.
    """
    ticks = list(data.ticks() if on_progress is None else _reported(data, on_progress))
    if not ticks:
        raise GcsError(f"{data.path}: there is no flight in it. {data.cut}".strip())
    time_s = np.array([tick.tick.time_s for tick in ticks])
    table = np.stack([tick.vehicles for tick in ticks])
    airborne = _among(data, table, IN_THE_AIR) | ((table["armed"] > 0) & (table["landed"] > Landed.ON_GROUND))
    held, held_at = _held(ticks)
    gaps = _gaps(ticks, time_s, airborne, {loss.to_s for loss in data.losses})
    uncertainty_m = table["position_uncertainty_m"]
    flown = _among(data, table, FLOWN) & np.isfinite(table["setpoint_x_m_s"])
    recent: Mask = table["position_age_s"] <= RECENT_S
    widest_m = float(np.nanmax(uncertainty_m[airborne], initial=0.0))
    position_m = layout.vectors(table, layout.POSITION)
    formed = flown & _among(data, table, {Phase.FORMATION})
    return _with_gaps(
        FlownTrajectories(
            "estimated positions",
            "what the autopilots reported, brought forward to each tick; each with a standard deviation"
            f" of up to {widest_m:.2f} m sideways",
            data.about.ids,
            time_s,
            position_m,
            layout.vectors(table, layout.VELOCITY),
            uncertainty_m,
            airborne,
            flown,
            formed,
            recent,
            layout.vectors(table, layout.SETPOINT),
            (*_late(flown, recent), *_several(held_at, airborne)),
            (
                *_before(data, ticks[0], flies=bool(airborne[0].any())),
                *data.damages,
                *(text for _, text in gaps),
                *_unknown(data.about.ids, position_m, airborne),
            ),
            held,
            held_at,
            held_at,
            data.about.autopilots,
            target_tracking(ticks, _center_m(position_m, formed)),
            traffic_passed(ticks, data.about.ids, position_m, airborne),
            data.about.site_hash,
            _shows_flown(ticks, airborne),
            _greatest_wind_m_s(ticks),
        ),
        [at for at, _ in gaps],
    )


def _greatest_wind_m_s(ticks: Sequence[RecordedSample]) -> float | None:
    """The greatest wind of the flight, with gusts, as the vehicles measured it; None: they measured none."""
    winds = {id(tick.features): tick.features.wind for tick in ticks}.values()
    return max((each.greatest_m_s for each in winds if each and each.greatest_m_s is not None), default=None)


def _shows_flown(ticks: Sequence[RecordedSample], airborne: Mask) -> tuple[str, ...]:
    flies = np.flatnonzero(airborne.any(axis=1)).tolist()
    flown = (ticks[at].status.selected for at in flies)
    return tuple(dict.fromkeys(selected.hash for selected in flown if selected is not None))


def _center_m(position_m: Single, formed: Mask) -> Array:
    """(k, 2) Mean of the vehicles in the formation; NaN: there are none, or one is not known."""
    with np.errstate(invalid="ignore"):
        summed_m = np.where(formed[..., None], position_m[..., :2], 0.0).sum(axis=1, dtype=np.float64)
        return np.asarray(summed_m / formed.sum(axis=1, keepdims=True))


def _late(flown: Mask, recent: Mask) -> tuple[str, ...]:
    """Describe where accelerations are not judged."""
    late = flown & ~recent
    if not late.any():
        return ()
    positions = f"{late.sum()} of {flown.sum()} positions in flight"
    return (f"{positions} are older than {RECENT_S} s: with these acceleration is not judged",)


def _several(held_at: NDArray[np.intp], airborne: Mask) -> tuple[str, ...]:
    """Describe what a worst value is where limits changed in flight."""
    if len(np.unique(held_at[airborne.any(axis=1)])) < 2:
        return ()
    return ("limits changed in flight: each value below is the one nearest to its limit then",)


def _reported(data: FlightData, on_progress: OnProgress) -> Iterator[RecordedSample]:
    """Yield every tick, and report the share of the file's time that is read."""
    first_s = data.chunks[0][0] if data.chunks else None
    last_s = data.last_s()
    for number, tick in enumerate(data.ticks()):
        if number % REPORTED_TICKS == 0 and first_s is not None and last_s is not None and last_s > first_s:
            on_progress(min(1.0, (tick.unix_s - first_s) / (last_s - first_s)))
        yield tick


def _held(ticks: Sequence[RecordedSample]) -> tuple[tuple[RecordedLimits | None, ...], NDArray[np.intp]]:
    """Return the recorded limits, each once, and which of them applied at each tick."""
    held: list[RecordedLimits | None] = []
    at = []
    for tick in ticks:
        limits = tick.status.limits
        if limits not in held:
            held.append(limits)
        at.append(held.index(limits))
    return tuple(held), np.array(at, np.intp)


def _before(data: FlightData, first: RecordedSample, *, flies: bool) -> list[str]:
    """Describe what was not recorded before the first tick, if a vehicle flies in that."""
    lost = first.tick.number - 1
    if any(loss.from_s is None for loss in data.losses):
        return []  # it is damaged, and reported as such
    return [f"{lost} ticks before the first were not recorded"] if flies and lost > 0 else []


def _gaps(
    ticks: Sequence[RecordedSample], time_s: Array, airborne: Mask, reported: set[float | None]
) -> list[tuple[int, str]]:
    """Gaps while a vehicle flies: the sample after each, and a description; without those in `reported`."""
    numbers = [tick.tick.number for tick in ticks]
    gaps = []
    for at in range(1, len(ticks)):
        away_s, lost = time_s[at] - time_s[at - 1], numbers[at] - numbers[at - 1] - 1
        if ticks[at].unix_s in reported:
            gaps.append((at, ""))
        elif airborne[at - 1 : at + 1].any() and (lost > 0 or away_s > GAP_S):
            of = f"{lost} ticks were not recorded" if lost > 0 else "nothing was recorded"
            gaps.append(
                (at, f"{of} from {time_s[at - 1] - time_s[0]:.2f} s to {time_s[at] - time_s[0]:.2f} s")
            )
    if len([text for _, text in gaps if text]) > GAPS_REPORTED:
        total_s = sum(time_s[at] - time_s[at - 1] for at, text in gaps if text)
        rest = f"in {len(gaps)} places ticks were not recorded, {total_s:.2f} s together"
        return [(at, rest if number == 0 else "") for number, (at, _) in enumerate(gaps)]
    return gaps


def _unknown(ids: Sequence[VehicleId], position_m: Single, airborne: Mask) -> list[str]:
    blind = (airborne & ~np.isfinite(position_m).all(axis=2)).sum(axis=0)
    names = [name for name, count in zip(ids, blind.tolist(), strict=True) if count]
    return [f"in the air, at a position that is not known: {', '.join(names)}"] if names else []


def _with_gaps(trajectories: FlownTrajectories, before: Sequence[int]) -> FlownTrajectories:
    """Insert an unknown sample before each of these, so that no straight path is assumed."""
    missing = tuple(text for text in trajectories.missing if text)
    if not before:
        return replace(trajectories, missing=missing)
    time_s, held_at = trajectories.time_s, trajectories.held_at
    middle_s = [(time_s[at - 1] + time_s[at]) / 2.0 for at in before]
    at = None if held_at is None else np.insert(held_at, before, held_at[np.array(before) - 1])
    with_unknown = {
        name: np.insert(values, before, UNKNOWN[name], axis=0)
        for name in UNKNOWN
        if (values := getattr(trajectories, name)) is not None
    }
    return replace(
        trajectories,
        time_s=np.insert(time_s, before, middle_s),
        missing=missing,
        held_at=at,
        setpoint_held_at=at,
        **with_unknown,
    )


def _among(data: FlightData, table: NDArray[np.void], phases: frozenset[Phase] | set[Phase]) -> Mask:
    numbers = [number for number, phase in enumerate(data.about.phases) if phase in phases]
    among: Mask = np.isin(table["phase"], numbers)
    return among


def true(
    files: Sequence[Path],
    frame: ShowFrame,
    beside: FlownTrajectories | None,
    ids: Sequence[VehicleId],
    on_progress: OnProgress | None = None,
) -> FlownTrajectories:
    """Read true trajectories from the files that `gcs sim --truth` writes.

    Args:
        files: each with the same vehicles from beginning to end.
        frame: of the show.
        beside: the same flight as estimated, by the same clock, for which were flown; None: by modes.
        ids: names of the vehicles by their numbers, the first has 1; empty: "1", "2" and so on.
        on_progress: is called with the share that is read, from 0 to 1.

    Raises: GcsError naming file and line.
    """
    states = read_true_states(files, on_progress)
    time_s, values = states.time_s, states.values
    velocity_m_s = frame.from_ned(values[..., 3:6].reshape(-1, 3)).reshape(*values.shape[:2], 3)
    names = tuple(ids[number - 1] if number <= len(ids) else str(number) for number in states.numbers)
    flown = formed = values[..., 7] > 0.5
    setpoint_m_s = held_at = None
    autopilots: tuple[str, ...] = ()
    if beside is not None and set(names) <= set(beside.ids):
        rows = [beside.ids.index(name) for name in names]
        autopilots = tuple(beside.autopilots[row] for row in rows)
        at = np.clip(np.searchsorted(beside.time_s, time_s, side="right") - 1, 0, len(beside.time_s) - 1)
        during = ((time_s >= beside.time_s[0]) & (time_s <= beside.time_s[-1]))[:, None]
        flown, formed = (mask[at][:, rows] & during for mask in (beside.flown, beside.formed))
        setpoint_m_s = None if beside.setpoint_m_s is None else beside.setpoint_m_s[:, rows]
        held_at = None if beside.held_at is None else beside.held_at[at]
    else:
        formed = np.zeros_like(flown)
    cut = [f"{file}: its last line is cut off" for file in states.cut]
    return FlownTrajectories(
        "true positions",
        "the simulation's own states, every 0.05 s and straight between; rounded to 0.1 mm",
        names,
        time_s,
        states.position_m(frame).astype(np.float32),
        velocity_m_s.astype(np.float32),
        np.zeros(values.shape[:2], np.float32),
        values[..., 6] > 0.5,
        flown,
        formed,
        np.ones_like(flown),
        setpoint_m_s,
        (),
        (*cut, *(() if beside is None else (*beside.missing, *_outside(beside, time_s)))),
        (None,) if beside is None or held_at is None else beside.held,
        held_at,
        None if beside is None or held_at is None else beside.setpoint_held_at,
        autopilots,
        () if beside is None else beside.tracking,
        () if beside is None else beside.traffic,
    )


@dataclass(frozen=True, slots=True, eq=False)
class TrueStates:
    """k samples of n vehicles, nine values each."""

    numbers: tuple[int, ...]  # of the vehicles in the simulation, from 1
    time_s: Array  # (k,) monotonic clock
    values: Array  # (k, n, 9) latitude, longitude, altitude, velocity NED, airborne, in OFFBOARD, armed
    cut: tuple[Path, ...] = ()  # files whose last line is cut off

    def position_m(self, frame: ShowFrame) -> Array:
        """(k, n, 3) Positions in the show frame."""
        count, n = self.values.shape[:2]
        return frame.position_m(*(self.values[..., axis].ravel() for axis in range(3))).reshape(count, n, 3)


def read_true_states(
    files: Sequence[Path], on_progress: OnProgress | None = None, *, period_s: float = TRUTH_S
) -> TrueStates:
    """Join the files that `gcs sim --truth` writes; `period_s` separates the common times.

    Raises: GcsError naming file and line.
    """

    def report(before: int, share: float) -> None:
        """Report the share of one file as a share of all, of which `before` are read."""
        if on_progress is not None:
            on_progress((before + share) / len(files))

    parts = [_read(file, partial(report, before)) for before, file in enumerate(files)]
    start_s, end_s = max(part.time_s[0] for part in parts), min(part.time_s[-1] for part in parts)
    named = ", ".join(str(file) for file in files)
    if not start_s < end_s:
        raise GcsError(f"{named}: they have no time in common")
    time_s = np.arange(start_s, end_s, period_s)
    numbers = tuple(number for part in parts for number in part.numbers)
    if len(set(numbers)) < len(numbers):
        raise GcsError(f"{named}: a vehicle is there twice")
    values = np.concatenate([interpolated(part.time_s, part.values, time_s) for part in parts], axis=1)
    return TrueStates(numbers, time_s, values, tuple(file for part in parts for file in part.cut))


def _outside(beside: FlownTrajectories, time_s: Array) -> list[str]:
    """Describe what flew before or after the times of the true positions."""
    flew_s = beside.time_s[beside.airborne.any(axis=1)]
    if not len(flew_s) or (flew_s[0] > time_s[0] - GAP_S and flew_s[-1] < time_s[-1] + GAP_S):
        return []
    began_s = beside.time_s[0]
    covered = f"{time_s[0] - began_s:.2f} s to {time_s[-1] - began_s:.2f} s"
    flew = f"{flew_s[0] - began_s:.2f} s to {flew_s[-1] - began_s:.2f} s"
    return [f"true positions are known from {covered}, and a vehicle flew from {flew}"]


def interpolated(time_s: Array, values: Array, at_s: Array) -> Array:
    """(j, ...) Values (k, ...), known at (k,) times, at (j,) other times."""
    columns = [np.interp(at_s, time_s, column) for column in values.reshape(len(time_s), -1).T]
    return np.stack(columns, axis=1).reshape(len(at_s), *values.shape[1:])


def _read(file: Path, report: OnProgress) -> TrueStates:
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise GcsError(f"{file}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise GcsError(f"{file}: not a truth file: not text") from None
    samples, is_cut = [], False
    for number, line in enumerate(lines, start=1):
        if number % REPORTED_TICKS == 0:
            report(number / len(lines))
        try:
            samples.append(_sample(json.loads(line)))
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            is_cut = number == len(lines) and bool(samples)  # the process was killed while writing it
            if not is_cut:
                reported = f"{type(error).__name__}: {error}"
                raise GcsError(f"{file}, line {number}: not a sample of true states: {reported}") from None
    if len(samples) < 2:
        raise GcsError(f"{file}: no true states were written")
    numbers = samples[0][1]
    if odd := next((number for number, sample in enumerate(samples, 1) if sample[1] != numbers), 0):
        raise GcsError(f"{file}, line {odd}: other vehicles than in line 1")
    time_s = np.array([sample[0] for sample in samples])
    if not (np.diff(time_s) > 0).all():
        raise GcsError(f"{file}: its times do not increase")
    values = np.array([sample[2] for sample in samples])
    return TrueStates(numbers, time_s, values, (file,) if is_cut else ())


def _sample(raw: Mapping[str, Any]) -> tuple[float, tuple[int, ...], list[list[float]]]:
    """Return time, vehicle numbers, values. Raises: ValueError, KeyError or TypeError if invalid."""
    vehicles = raw["vehicles"]
    place = ("latitude_deg", "longitude_deg", "altitude_amsl_m")
    names = (*place, "velocity_north_m_s", "velocity_east_m_s", "velocity_down_m_s")
    values = [
        [
            *(float(vehicle[name]) for name in names),
            not vehicle["landed"],
            vehicle["mode"] == "OFFBOARD",
            bool(vehicle["armed"]),
        ]
        for vehicle in vehicles
    ]
    return float(raw["time_s"]), tuple(int(vehicle["vehicle"]) for vehicle in vehicles), values
