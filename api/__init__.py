"""The REST API and the stream, over `gcs.service.Service` alone."""
