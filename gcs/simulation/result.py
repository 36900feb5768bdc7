"""What a simulated flight was, as arrays and figures."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gcs.model.state import Array, Mask
from gcs.simulation.metrics import FlightMetrics
from gcs.simulation.record import FlightRecord

Single = NDArray[np.float32]

OF_EACH: Final = ("time", "vehicle")

DIMS: Final[dict[str, tuple[str, ...]]] = {
    "time_s": ("time",),
    "vehicle": ("vehicle",),
    "position_m": (*OF_EACH, "axis"),
    "velocity_m_s": (*OF_EACH, "axis"),
    "setpoint_m_s": (*OF_EACH, "axis"),
    "limited_by": OF_EACH,
    "task": OF_EACH,
    "in_air": OF_EACH,
    "centre_m": ("time", "axis"),
    "radius_m": ("time",),
    "target_m": ("time", "level"),
    "closest_m": ("time",),
}
"""The arrays of a flight and their dimensions: k times, n vehicles, the axes x, y, z, and of those x, y."""

AXES: Final = ("x", "y", "z")


@dataclass(frozen=True, slots=True, eq=False)
class FlightResult:
    """A flight that was flown: k ticks of n vehicles.

    Positions and velocities are the true ones, in the show frame: x along the show's heading, y to its right,
    z down; with heading 0 it is NED. Row i is the state at `time_s[i]`, and what was decided then.
    """

    seed: int
    metrics: FlightMetrics  # what `gcs simulate --json` prints
    time_s: Array  # (k,) since the vehicles were engaged
    vehicle: NDArray[np.str_]  # (n,) their names: d1, d2, ...
    position_m: Single  # (k, n, 3)
    velocity_m_s: Single  # (k, n, 3) over ground
    setpoint_m_s: Single  # (k, n, 3) as sent after the safety filter; NaN: none was sent
    limited_by: NDArray[np.object_]  # (k, n) texts: why the filter changed a velocity, "" where it did not
    task: NDArray[np.int8]  # (k, n) of `Task`: what the tick did with each vehicle
    in_air: Mask  # (k, n)
    centre_m: Array  # (k, 3) commanded centre of the sphere; NaN: there is none
    radius_m: Array  # (k,) of the sphere
    target_m: Array  # (k, 2) true place of the target on the ground
    closest_m: Array  # (k,) least distance of two until the next tick, in the floor's metric; 1e9: no pair

    @staticmethod
    def of(record: FlightRecord, metrics: FlightMetrics) -> "FlightResult":
        """Make it of a record with `details`."""
        details = record.details
        if details is None:
            raise ValueError("a record without details")
        return FlightResult(
            seed=record.seed,
            metrics=metrics,
            time_s=np.array(record.time_s),
            vehicle=np.array([f"d{row + 1}" for row in range(record.count)]),
            position_m=np.array(record.position_m, np.float32),
            velocity_m_s=np.array(details.velocity_m_s),
            setpoint_m_s=np.array(details.setpoint_m_s),
            limited_by=np.array(details.limited_by, np.object_),
            task=np.array(details.task),
            in_air=np.array(record.in_air),
            centre_m=np.array(record.center_m),
            radius_m=np.array(record.radius_m),
            target_m=np.array(record.target_m),
            closest_m=np.array(record.closest_m),
        )

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All arrays by name; their dimensions are in `DIMS`.

        For xarray: `Dataset({name: (DIMS[name], array) for name, array in flight.arrays().items()})`.
        """
        return {name: getattr(self, name) for name in DIMS}

    def table(self) -> dict[str, NDArray[Any]]:
        """Columns with a row for each time and vehicle, for `pandas.DataFrame`; all times of a tick together.

        `position_m` becomes position_x_m, position_y_m and position_z_m, other arrays likewise. Of each time
        only `time_s` is repeated.
        """
        k, n = self.task.shape
        columns: dict[str, NDArray[Any]] = {
            "time_s": np.repeat(self.time_s, n),
            "vehicle": np.tile(self.vehicle, k),
        }
        for name, array in self.arrays().items():
            if DIMS[name] == OF_EACH:
                columns[name] = array.ravel()
            elif DIMS[name][:2] == OF_EACH:
                quantity, _, unit = name.partition("_")
                columns |= {f"{quantity}_{axis}_{unit}": array[..., i].ravel() for i, axis in enumerate(AXES)}
        return columns
