"""JSON and binary schemas of the API, and their conversion from the service's types."""
