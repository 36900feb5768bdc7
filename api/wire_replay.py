"""JSON names of a replay: how it is played, and the judgement of its record."""

from typing import Final

from pydantic import BaseModel, ConfigDict, Field

SPEED_MAX: Final = 100.0


class Replay(BaseModel):
    """A recorded flight that is played as if live."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    file: str
    began_unix_time_s: float = Field(
        description="Of the first recorded state; a state's own tells where it is."
    )
    duration_s: float
    position_s: float = Field(description="Since the first recorded state, at this state.")
    speed: float = Field(description="Times as fast as it was flown.")
    paused: bool
    ended: bool = Field(description="The last recorded state is shown.")
