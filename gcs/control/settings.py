"""Settings of the tick."""

from gcs.formation.law import LawSettings
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.safety.filter import SafetySettings


class ControlSettings(Settings):
    """Settings of law, safety filter and inner loop."""

    law: LawSettings = LawSettings()
    safety: SafetySettings = SafetySettings()
    loop_gain: NotNegative = 1.5
    vertical_loop_gain: NotNegative = 0.0  # PX4's vertical response is fast; 1.5 oscillates at 1.4 Hz
    lead_s: NotNegative = 0.5
    trim_rate_per_s: NotNegative = 1.0
    vertical_trim_rate_per_s: NotNegative = 0.5
    trim_max_m_s: NotNegative = 4.0
    response_s: Positive = 0.4  # time constant of a vehicle's response within the inner loop
    acceleration_max_m_s2: Positive = 3.0  # of the desired velocity
    radius_rate_m_s: Positive = 1.0
    yaw_rate_max_deg_s: Positive = 45.0
    telemetry_age_max_s: Positive = 0.5
