"""Settings of Remote ID. No I/O."""

from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from gcs.links.targets.settings import TargetSource
from gcs.model.settings import Settings

TEXT_MAX, ID_MAX = 23, 20
"""Characters of a self-id, and of other ids."""

Identity = Annotated[str, Field(pattern=r"^[\x21-\x7e]{1,20}$")]

IDENTITIES: Final = {"serial-number": 1, "registration": 2, "utm": 3, "session": 4}
"""MAV_ODID_ID_TYPE."""

CATEGORIES: Final = {"undeclared": 0, "open": 1, "specific": 2, "certified": 3}
"""MAV_ODID_CATEGORY_EU."""


class BasicId(Settings):
    """Identity of one vehicle, where its transponder does not have it."""

    kind: Literal["serial-number", "registration", "utm", "session"] = "serial-number"
    """`serial-number` (ANSI/CTA-2063), `registration` at the authority, `utm` or `session`."""
    id: Identity
    """The identity, up to 20 characters without spaces."""


class OperatorPlace(Settings):
    """Where the operator stands."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    """Latitude, in degrees."""
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]
    """Longitude, in degrees."""
    altitude_amsl_m: Annotated[float, Field(ge=-500, le=9000)]
    """Altitude above mean sea level, in m."""


class RemoteIdSettings(Settings):
    """What is sent for Remote ID (docs/how-to/remote-id-and-fences.md)."""

    operator_id: Annotated[str, Field(pattern=r"^[\x20-\x7e]{0,20}$")] = ""
    """Id of the operator, as its authority issued it, up to 20 characters; empty: none is sent."""
    self_id: Annotated[str, Field(pattern=r"^[\x20-\x7e]{0,23}$")] = ""
    """What the flight is for, in up to 23 characters; empty: none is sent."""
    operator: OperatorPlace | None = None
    """Where the operator stands, if it stands still."""
    source: TargetSource | None = None
    """A receiver that the operator carries, as those of targets; in place of `operator`."""
    geoid_m: Annotated[float, Field(ge=-110, le=90)]
    """Height of the geoid above the WGS84 ellipsoid there, in m: altitudes of Remote ID count from that."""
    basic_ids: Annotated[dict[str, BasicId], Field(default_factory=dict, max_length=1000)]
    """Identities by vehicle, for transponders that have none of their own."""
    category: Literal["undeclared", "open", "specific", "certified"] = "undeclared"
    """Category of the flight in the European Union; `undeclared` outside of it."""
    class_eu: Annotated[int, Field(ge=0, le=7)] = 0
    """Class of the vehicles in the European Union: their number + 1, 0 undeclared (MAV_ODID_CLASS_EU)."""
    require: bool = True
    """Whether a start is refused unless the transponder of each vehicle reports that it is ready."""

    @model_validator(mode="after")
    def _check(self) -> "RemoteIdSettings":
        if (self.operator is None) == (self.source is None):
            raise ValueError("operator or source: one of them is needed, and not both")
        return self
