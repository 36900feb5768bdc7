"""Ground station that flies a self-organising formation of drones on a virtual sphere."""
