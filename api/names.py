"""Names in paths and bodies: bounded, so that no answer has to repeat a long one."""

from typing import Annotated, Final

from fastapi import Path
from pydantic import Field

NAME_MAX: Final = 64
"""Characters; the configuration allows vehicles 32."""

VehicleName = Annotated[str, Field(max_length=NAME_MAX, examples=["d1"])]
VehicleId = Annotated[str, Path(max_length=NAME_MAX, examples=["d1"])]
ObstacleId = Annotated[str, Path(max_length=NAME_MAX, examples=["tower"])]
AlarmId = Annotated[str, Path(max_length=NAME_MAX)]
OrderId = Annotated[str, Path(max_length=NAME_MAX)]
