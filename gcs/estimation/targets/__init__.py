"""Where targets are, and how they move: estimated from what their sources report. Pure."""
