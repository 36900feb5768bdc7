"""Names in bodies, of bounded length, so that no response repeats a long one."""

from typing import Annotated, Final

from pydantic import Field

NAME_MAX: Final = 64
"""Most characters of a name; the configuration allows 32 for vehicles."""

VehicleName = Annotated[str, Field(max_length=NAME_MAX, examples=["d1"])]
