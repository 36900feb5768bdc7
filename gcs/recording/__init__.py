"""Records of flights: audit in SQLite, flight data in MCAP; imports service, links and what lies below."""
