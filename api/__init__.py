"""The REST API, its stream and the console's files; imports only service and model."""
