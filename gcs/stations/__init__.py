"""Several stations that fly one formation: what they send each other, and what each knows; pure."""
