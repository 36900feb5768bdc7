"""Turns telemetry into the state of the fleet, with its uncertainty; pure, imports only model."""
