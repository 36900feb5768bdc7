"""What every group of settings shares: frozen, no unknown keys, finite numbers, a unit in every name."""

from typing import Annotated, TypeAlias

from pydantic import BaseModel, ConfigDict, Field

Positive: TypeAlias = Annotated[float, Field(gt=0)]
NotNegative: TypeAlias = Annotated[float, Field(ge=0)]


class Settings(BaseModel):
    """Base of every group; `gcs.config` reads them from YAML, tests and tools construct them directly."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
