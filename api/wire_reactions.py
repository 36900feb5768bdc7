"""The JSON names of what the service does by itself."""

from pydantic import BaseModel, ConfigDict, Field

from gcs.reactions import Action, Cause


class Reaction(BaseModel):
    """One reaction, for as long as its cause lasts."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    cause: Cause
    action: Action = Field(description="Of the vehicles named, or of the whole show.")
    reason: str = Field(examples=["battery at 15%, below 20%"])
    vehicles: list[str] = Field(description="Whom it concerns; empty: nobody in particular.")
    since_time_s: float = Field(description="The service's monotonic clock.")
    since_unix_time_s: float
    order_id: str | None = Field(
        description="What was ordered for it; null: nothing yet, or what goes on is no weaker."
    )
