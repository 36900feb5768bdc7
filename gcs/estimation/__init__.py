"""Turns telemetry into the fleet's state, its uncertainty, the health of links; pure, imports only model."""
