"""Failsafe policy, triggers, arbitration, autopilots' own failsafes; pure, imports safety and model."""
