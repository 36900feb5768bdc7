"""What differs between the autopilots of fake vehicles: one firmware for each, behind one protocol."""
