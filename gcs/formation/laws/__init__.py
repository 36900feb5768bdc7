"""Laws as plug-ins: their protocol, those that are shipped, and how one is found by its name."""
