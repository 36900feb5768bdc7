"""The safety filter, the last step before setpoints leave; pure, imports only formation and model."""
