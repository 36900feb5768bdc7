"""The defaults that hold without configuration."""

from gcs.safety.constraints import Braking
from gcs.safety.floor import Floor
from gcs.safety.surroundings import Limits, SafetySettings
from gcs.safety.traffic import Traffic
from gcs.safety.walls import Fence


def test_default_safety_settings_are_those_derived_and_flown() -> None:
    # docs/decisions/filter.md: a change of one of these changes how far apart the vehicles are held
    assert SafetySettings() == SafetySettings(
        limits=Limits(horizontal_m_s=8.0, up_m_s=2.5, down_m_s=1.4),
        floor=Floor(
            horizontal_m=2.0,
            vertical_m=3.0,
            margin_m=0.3,
            uncertainty_m=0.05,
            vertical_uncertainty=2.0,
            deviations=6.0,
            pad_height_m=2.0,
        ),
        fence=Fence(height_min_m=3.0, height_max_m=100.0, distance_max_m=300.0),
        braking=Braking(reaction_s=0.8, lead_s=0.6, deceleration_m_s2=2.0, escape_rate_per_s=1.5),
        traffic=Traffic(
            angle_max_deg=45.0,
            passing_m=8.0,
            crowd=4.0,
            horizon_s=10.0,
            give_way_m=10.0,
            give_way_fully_m=6.0,
        ),
        link_delay_s=0.0,
    )
