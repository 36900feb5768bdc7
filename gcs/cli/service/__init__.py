"""`gcs serve`: the service, the process of its API, its priority and its restart."""
