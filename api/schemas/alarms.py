"""The JSON names of alarms."""

from pydantic import BaseModel, ConfigDict, Field

from gcs.service.alarms import AlarmSeverity, OverallSeverity


class Alarm(BaseModel):
    """One condition that an operator should know, with all vehicles that it concerns."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    id: str = Field(examples=["vehicle-lost-7"])
    severity: AlarmSeverity = Field(
        description=(
            "emergency: act at once; warning: act soon; caution: be ready to act; information: nothing to do."
        )
    )
    cause: str = Field(
        description="One word for programs; docs/operations.md lists them.", examples=["vehicle-lost"]
    )
    text: str = Field(
        description="The cause first, its consequence after.",
        examples=["Vehicle d3 lost: no telemetry for 2.0 s. Formation closes the gap."],
    )
    advice: str = Field(description="What an operator can do.")
    vehicles: list[str] = Field(description="All that it concerns; empty: it concerns no vehicle.")
    since_unix_time_s: float = Field(description="When the cause began.")
    raised_unix_time_s: float = Field(
        description=(
            "When it began, or last concerned a further vehicle or became more severe: it then is no longer"
            " acknowledged. The newest of a severity is listed first."
        )
    )
    acknowledged_by: str | None = Field(description="Name of the token used; null: not acknowledged.")
    acknowledged_unix_time_s: float | None
    ended_unix_time_s: float | None = Field(
        description=(
            "null: the cause lasts. Emergencies and warnings stay listed after their cause has ended until"
            " they are acknowledged; they do not count for the state of the whole."
        )
    )
    command_id: str | None = Field(description="The command that the service gave because of it; null: none.")


class AlarmList(BaseModel):
    """All alarms, and the overall severity."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    severity: OverallSeverity = Field(description="The worst severity of the alarms that last.")
    alarms: list[Alarm] = Field(
        description="Lasting alarms before ended ones; the most severe first, of one severity the newest."
    )
