"""Print a number of two vehicles as each place has it, and the OpenAPI document: `number_everywhere NAME`.

It runs beside whatever tree of `gcs` comes first on the path; tests/unit/model/test_adding_a_number.py.
"""

import json
import sys
from types import SimpleNamespace
from typing import Any

import numpy as np

from gcs.api.app import routed
from gcs.api.metrics import FleetCollector
from gcs.api.schemas import binary_frame, convert
from gcs.api.schemas.fleet import FRAME_COLUMNS
from gcs.flight.monitors.snapshots import measured
from gcs.model.frames import ShowFrame
from gcs.model.lifecycle import ShowPhase
from gcs.model.vehicle_columns import COLUMNS, SENT
from gcs.recording import mcap_layout
from gcs.service import FleetView
from gcs.service.vehicle_table import VehicleTable
from gcs.stations.messages import BatchHead, StateBatch, decode_batch, numbers_of
from gcs.stations.reported_vehicles import ReportedVehicles, take
from tests.support import record_samples
from tests.support.reported import reported

FRAME = ShowFrame(47.4, 8.5, 488.0, 0.0)


def flown() -> FleetView:
    """A view of two vehicles, with the numbers that a flight measures of them."""
    ids, zeros = record_samples.ids_of(2), np.zeros(2)
    newest: Any = SimpleNamespace(
        state=SimpleNamespace(ids=ids, time_s=1.0, yaw_rad=zeros, age_s=zeros),
        telemetry=reported(ids),
        traits=SimpleNamespace(uncertainty_m=zeros),
    )
    link_quality: Any = SimpleNamespace(share=zeros)
    columns: dict[str, Any] = {**measured(newest, link_quality)}
    return record_samples.sample(2, **columns).view


def framed(view: FleetView, name: str) -> list[float]:
    data = binary_frame.encode(view, FRAME, revision=1, alive=True)
    names, n = [column.name for column in FRAME_COLUMNS], len(view.rows.ids)
    columns = np.frombuffer(data, "<f4", len(names) * n, binary_frame.HEADER.itemsize).reshape(-1, n)
    shown: list[float] = columns[names.index(name)].tolist()
    return shown


def elsewhere(rows: VehicleTable, name: str) -> list[float]:
    """As the other stations of a site show it."""
    n = len(rows.ids)
    vectors, flags, zeros = (np.zeros((n, 3)),) * 5, (np.ones(n, np.bool_),) * 6, np.zeros(n)
    codes, numbers = np.ones(n, np.uint8), [getattr(rows, sent) for sent in SENT]
    columns: Any = (*vectors, zeros, zeros, codes, codes, *flags, codes, zeros, numbers)
    batch = StateBatch(BatchHead(1, 1, 1, 0, ShowPhase.RUNNING, True, 1.0, np.nan, ()), *columns)
    known = ReportedVehicles.unknown(n)
    take(known, np.arange(n), decode_batch(batch.encode())[1], 1, 1.0)
    others = {column: getattr(rows, column) for column in VehicleTable.__dataclass_fields__}
    others = {column: values for column, values in others.items() if column not in COLUMNS}
    shown: list[float] = getattr(rows.followed_by({**others, **numbers_of(known.numbers)}), name)[n:].tolist()
    return shown


def places(name: str) -> dict[str, object]:
    view = flown()
    column = COLUMNS[name]
    points = mcap_layout.rows_of(mcap_layout.vehicles_message(1.0, mcap_layout.packed(view.rows)))
    metrics = FleetCollector(view, "", 0.0, "off", 0, 0).collect()
    return {
        "view": getattr(view.rows, name).tolist(),
        "frame": framed(view, column.api),
        "REST": [getattr(each, column.api) for each in convert.vehicles(view, FRAME)],
        "record": points[column.record].tolist(),
        "metrics": [
            sample.value for metric in metrics if metric.name == column.metric for sample in metric.samples
        ],
        "bus": elsewhere(view.rows, name),
    }


if __name__ == "__main__":
    print(json.dumps({"places": places(sys.argv[1]), "document": routed().openapi()}))  # noqa: T201
