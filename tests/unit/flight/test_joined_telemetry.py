from gcs.flight.state.flight import joined
from gcs.links.telemetry import FleetTelemetry


def test_telemetry_of_links_is_joined_in_the_fleets_order() -> None:
    one, other = FleetTelemetry(("a", "c")), FleetTelemetry(("b",))
    one.position_time_s[:], other.position_time_s[:] = (1.0, 3.0), 2.0
    one.armed[1] = True
    parts = [one.telemetry(), other.telemetry()]
    whole = joined(parts, [0, 2, 1])
    assert whole.ids == ("a", "b", "c")
    assert whole.position_time_s.tolist() == [1.0, 2.0, 3.0]
    assert whole.armed == (False, False, True)
    assert joined(parts, None).ids == ("a", "c", "b")
    assert joined(parts[:1], None) is parts[0]
