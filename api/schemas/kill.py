"""JSON schemas of a kill, in two steps."""

from typing import Annotated

from pydantic import ConfigDict, Field

from gcs.api.schemas.names import VehicleName
from gcs.api.schemas.rest import ABSENT, Inward, Outward, without_defaults

CODE_PATTERN = r"^[0-9a-f]{6}$"


# In


class KillBody(Inward):
    """The vehicles whose motors are to be stopped."""

    model_config = ConfigDict(json_schema_extra=without_defaults)

    vehicles: Annotated[list[VehicleName], Field(min_length=1, max_length=10_000, examples=[["d1"]])] = Field(
        default=ABSENT, description="Absent: all vehicles that are not offline."
    )


class KillConfirmation(Inward):
    """The second step of a kill: its code."""

    code: Annotated[
        str,
        Field(
            pattern=CODE_PATTERN, description="The code that the first step returned.", examples=["a1b2c3"]
        ),
    ]


# Out


class KillArmed(Outward):
    """The vehicles that the code will kill; nothing has been sent to them yet."""

    code: str
    vehicles: list[str]
    valid_s: float = Field(description="Time for which the code is valid.")
