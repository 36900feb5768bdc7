"""Records of flights: audit in SQLite, data in MCAP; imports control, service, links and what lies below."""
