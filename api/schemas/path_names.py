"""Names in paths, bounded as in bodies."""

from typing import Annotated

from fastapi import Path

from gcs.api.schemas.names import NAME_MAX

VehicleId = Annotated[str, Path(max_length=NAME_MAX, examples=["d1"])]
ObstacleId = Annotated[str, Path(max_length=NAME_MAX, examples=["tower"])]
CommandId = Annotated[str, Path(max_length=NAME_MAX)]
AlarmId = Annotated[str, Path(max_length=NAME_MAX)]
