"""`gcs kill`: stops motors, through the service and without it."""
