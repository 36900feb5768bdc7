"""The control law: one velocity per vehicle from the state of the fleet; pure, imports only model."""
