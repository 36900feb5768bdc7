"""Names in bodies: bounded, so that no answer has to repeat a long one."""

from typing import Annotated, Final

from pydantic import Field

NAME_MAX: Final = 64
"""Characters; the configuration allows vehicles 32."""

VehicleName = Annotated[str, Field(max_length=NAME_MAX, examples=["d1"])]
