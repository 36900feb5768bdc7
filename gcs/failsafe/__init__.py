"""Failsafe policy, triggers, arbitration, autopilots' failsafes; pure, imports safety, estimation, model."""
