"""One state as bytes for the console: see docs/stream.md.

A header, then one column after another with one value per vehicle: single precision first, then bytes.
All values are little-endian. Unknown values are NaN.
"""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gcs.model.frames import ShowFrame
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Mode
from gcs.model.vehicle_columns import COMPUTED, FRAME, IN_FRAME
from gcs.service import Estimates, FleetView
from gcs.service.vehicle_table import VehicleTable

VERSION: Final = 4

HEADER: Final = np.dtype(
    {
        "names": [
            *("version", "control_alive", "has_center", "show", "n", "revision", "tick_count"),
            *("time_s", "unix_time_s", "missed", "setpoints_sent", "interventions"),
            *("center_x_m", "center_y_m", "center_height_m", "target_x_m", "target_y_m", "radius_m"),
            *("minimum_separation_m", "rate_hz", "p50_ms", "p99_ms", "lateness_p99_ms"),
            *("clock_s", "countdown_s"),
            *("battery_least", "battery_median", "assembled_s", "home_s", "battery_least_row"),
            *("label", "behind_s", "tempo"),
        ],
        "formats": [
            *("u1", "u1", "u1", "u1", "<u4", "<u4", "<u4", "<f8", "<f8", "<u4", "<u4", "<u4"),
            *(["<f4"] * 17),
            *("<u4", "(4,)u1", "<f4", "<f4"),
        ],
        "offsets": [0, 1, 2, 3, 4, 8, 12, 16, 24, 32, 36, 40, *range(48, 120, 4), 44, 120, 124],
        "itemsize": 128,
    }
)

FLOATS: Final = tuple(FRAME)
"""Columns in single precision, in their order: their table is `gcs.model.vehicle_columns.FRAME`."""

BYTES: Final = ("phase", "mode", "landed", "flags", "red", "green", "blue")
"""Columns of bytes, in their order."""

ARMED, READY, LIMITED, COMMANDED, LIT = (1 << bit for bit in range(5))
"""Bits of `flags`."""

NO_ROW: Final = 2**32 - 1
"""Row number for no row."""

UPWARDS: Final = np.array([1.0, 1.0, -1.0])

_PHASE: Final = {phase: number for number, phase in enumerate(Phase)}
_MODE: Final = {mode: number for number, mode in enumerate(Mode)}
_SHOW: Final = {phase: number for number, phase in enumerate(ShowPhase)}


def encode(view: FleetView, frame: ShowFrame, *, revision: int, alive: bool) -> bytes:
    """Encode one state and the revision of its status: `HEADER.itemsize` bytes, then the columns."""
    rows = view.rows
    n = len(rows.ids)
    floats_at = HEADER.itemsize
    bytes_at = floats_at + 4 * len(FLOATS) * n
    data = bytearray(bytes_at + len(BYTES) * n)
    _fill_header(np.frombuffer(data, HEADER, 1), view, revision=revision, alive=alive)
    table = np.frombuffer(data, "<f4", len(FLOATS) * n, floats_at).reshape(-1, n)
    fill_floats(table, rows, frame, view.estimates)
    _fill_bytes(np.frombuffer(data, np.uint8, len(BYTES) * n, bytes_at).reshape(-1, n), rows)
    return bytes(data)


def _fill_header(header: NDArray[np.void], view: FleetView, *, revision: int, alive: bool) -> None:
    x_m, y_m, z_m = (np.nan,) * 3 if view.center_m is None else view.center_m
    tick, selected, found = view.tick, view.selected, view.estimates
    times: tuple[float | None, ...] = (None,) * 4
    if found is not None:
        times = (found.battery_least, found.battery_median, found.assembled_s, found.home_s)
    least_row = None if found is None else found.battery_least_row
    header[0] = (
        VERSION,
        alive,
        view.center_m is not None,
        _SHOW[view.show],
        len(view.rows.ids),
        *(count % 2**32 for count in (revision, tick.count)),
        view.time_s,
        view.unix_time_s,
        *(count % 2**32 for count in (tick.missed, view.setpoints_sent, view.interventions)),
        *(x_m, y_m, 0.0 - z_m, *view.target_m),
        _or_nan(view.radius_m),
        _or_nan(view.minimum_separation_m),
        *(tick.rate_hz, tick.duration_p50_ms, tick.duration_p99_ms, tick.lateness_p99_ms),
        np.nan if selected is None else selected.clock_s,
        _or_nan(view.countdown_s),
        *map(_or_nan, times),
        NO_ROW if least_row is None else least_row,
        *view.features.show_clock,
    )


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else value


def fill_floats(
    table: NDArray[np.floating[Any]], rows: VehicleTable, frame: ShowFrame, found: Estimates | None
) -> None:
    """Fill a table of shape (len(FLOATS), n) with the columns of `FLOATS`; NaN: not known."""
    table[0:3] = (rows.position_m * UPWARDS).T
    table[3:6] = (rows.velocity_m_s * UPWARDS).T
    table[6] = (np.degrees(rows.yaw_rad) + frame.heading_deg) % 360.0
    table[7:10] = (rows.setpoint_m_s * UPWARDS).T
    table[10:12] = np.nan
    if found is not None:  # of the vehicles that this station flies: the first rows
        table[10:12, : len(found.low_s)] = found.low_s, found.empty_s
    table[len(COMPUTED) :] = [getattr(rows, name) for name in IN_FRAME]
    table[6][table[6] == 360.0] = 0.0  # single precision rounds headings just below 360 up
    table += 0.0  # no -0
    table[~np.isfinite(table)] = np.nan


def _fill_bytes(table: NDArray[np.uint8], rows: VehicleTable) -> None:
    def given(values: Sequence[object]) -> NDArray[np.bool_]:
        return np.fromiter(map(bool, values), np.bool_, len(rows.ids))

    table[0] = [_PHASE[phase] for phase in rows.phases]
    table[1] = [_MODE[mode] for mode in rows.modes]
    table[2] = rows.landed
    table[3] = (
        ARMED * given(rows.armed)
        + READY * given(rows.ready)
        + LIMITED * given(rows.limited_by)
        + COMMANDED * np.isfinite(rows.setpoint_m_s).all(axis=1)
        + LIT * rows.lit
    )
    table[4:7] = np.where(rows.lit, rows.colour.T, 0)
