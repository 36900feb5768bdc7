"""Typed Python client of the REST API; imports only the API's schemas and model."""
