"""Take-off, join, return and landing of vehicles, one by one and together."""
