"""The running flight: orchestrator, state, commands, maneuvers; imports all below but bus, stations, sim."""
