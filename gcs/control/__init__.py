"""One tick: the law, then safety. Pure: the same for real vehicles, fake ones and a simulation."""

from gcs.control.memory import Memory
from gcs.control.moment import ellipses_of
from gcs.control.settings import ControlSettings
from gcs.control.tasks import Task, Tasks
from gcs.control.ticking import Tick, tick, warm_up

__all__ = [
    "ControlSettings",
    "Memory",
    "Task",
    "Tasks",
    "Tick",
    "ellipses_of",
    "tick",
    "warm_up",
]
