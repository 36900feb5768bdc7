"""Failsafe policy, triggers and arbitration, and PX4's own failsafes; pure, imports only safety and model."""
