"""The running flight: orchestrator, state, commander, maneuvers, recovery; imports everything below it."""
