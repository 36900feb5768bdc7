"""One control tick: law, safety filter, setpoint shaping; pure, imports safety and what lies below."""

from gcs.control.inputs import ControlSettings, Task, Tasks, ellipses_of, ellipses_until
from gcs.control.memory import Memory
from gcs.control.tick_step import Tick, prepare, tick, warm_up

__all__ = [
    "ControlSettings",
    "Memory",
    "Task",
    "Tasks",
    "Tick",
    "ellipses_of",
    "ellipses_until",
    "prepare",
    "tick",
    "warm_up",
]
