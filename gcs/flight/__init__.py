"""The running flight: orchestrator, fleet, commander, maneuvers, recovery; imports everything below it."""
