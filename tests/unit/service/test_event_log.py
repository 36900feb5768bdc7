"""The newest events, in words."""

import logging

from gcs.service.event_log import KEPT, EventLog, Severity, attached


def test_newest_log_lines_are_kept_with_their_vehicles() -> None:
    events = EventLog()
    log = logging.getLogger("gcs.flight.state.vehicle")
    logger = logging.getLogger("gcs")
    before = logger.level, list(logger.handlers)
    with attached(events):
        stated = {"vehicle": "d1", "was": "hold", "phase": "formation", "reason": "offboard accepted"}
        log.info("vehicle_phase", extra=stated)
        logging.getLogger("gcs.api.auth.authorization").warning("access_denied")  # no event of the flight
        log.error("link_failed", extra={"link": "a", "cause": "no route"})
    log.error("link_failed", extra={"link": "a", "cause": "nothing listens"})
    first, second = events.newest()
    assert (first.number, first.severity, first.vehicle) == (1, Severity.INFO, "d1")
    assert first.text == "formation: offboard accepted"
    assert (second.severity, second.vehicle) == (Severity.ERROR, None)
    assert second.text == "link a failed, and is opened again: no route"
    assert (logger.level, list(logger.handlers)) == before


def test_event_log_is_limited_to_a_page() -> None:
    events = EventLog()
    with attached(events):
        for number in range(KEPT + 7):
            logging.getLogger("gcs").info("vehicle_connected", extra={"vehicle": f"d{number}"})
    newest = events.newest()
    assert [each.number for each in newest] == list(range(8, KEPT + 8))
    assert newest[-1].vehicle == f"d{KEPT + 6}"
