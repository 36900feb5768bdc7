"""Checks before take-off and the parameters they require; pure, imports config and what lies below."""
