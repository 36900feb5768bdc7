"""Checks before take-off and the PX4 parameters they require; pure, imports config and what lies below."""
