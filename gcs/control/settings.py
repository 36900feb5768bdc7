"""What the tick is set to."""

from gcs.formation.law import LawSettings
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.safety.filter import SafetySettings


class ControlSettings(Settings):
    """Law and safety, and how vehicles answer."""

    law: LawSettings = LawSettings()
    safety: SafetySettings = SafetySettings()
    loop_gain: NotNegative = 1.5
    vertical_loop_gain: NotNegative = 0.0  # PX4's vertical answer is fast; 1.5 swings at 1.4 Hz
    lead_s: NotNegative = 0.5
    trim_rate_per_s: NotNegative = 1.0
    vertical_trim_rate_per_s: NotNegative = 0.5
    trim_max_m_s: NotNegative = 4.0
    response_s: Positive = 0.4  # time constant of a vehicle's answer within the inner loop
    acceleration_max_m_s2: Positive = 3.0  # of the wanted velocity
    radius_rate_m_s: Positive = 1.0
    yaw_rate_max_deg_s: Positive = 45.0
    telemetry_age_max_s: Positive = 0.5
