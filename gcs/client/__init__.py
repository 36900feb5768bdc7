"""Typed Python client of the REST API; imports only the API's schemas, service and model."""

from gcs.client.fleet_client import URL, Client

__all__ = ["URL", "Client"]
