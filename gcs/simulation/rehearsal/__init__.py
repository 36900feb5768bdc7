"""A written show flown in virtual time, judged and drawn."""
