"""The law: where every drone should go. Pure functions over (n, 3) arrays; no clock, no I/O."""
