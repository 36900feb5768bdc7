"""The plan as JSON in the record, and back."""

import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

from gcs.model.plan import Direction, Formation, Obstacle, Orbit, Plan, Target, Yaw, YawPolicy


def plan_json(plan: Plan, **more: object) -> str:
    """The plan as JSON, with the fields `more` added; times are those of the loop's clock."""
    return json.dumps({**asdict(plan), **more}, separators=(",", ":"))


def plan_of(raw: Mapping[str, Any], shift_s: float) -> Plan:
    """A recorded plan, its times moved by `shift_s`.

    Raises: GcsError, KeyError, TypeError or ValueError when `raw` is not a plan.
    """
    target = Target(**raw["target"])
    boxes = [Obstacle(**box) for box in raw["obstacles"]]
    return Plan(
        Formation(**raw["formation"]),
        Orbit(**{**raw["orbit"], "direction": Direction(raw["orbit"]["direction"])}),
        replace(target, time_s=target.time_s + shift_s),
        tuple(replace(box, time_s=box.time_s + shift_s) for box in boxes),
        Yaw(YawPolicy(raw["yaw"]["policy"]), raw["yaw"]["fixed_rad"]),
    )
