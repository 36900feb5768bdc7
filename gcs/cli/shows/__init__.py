"""`gcs show`: a show checked by flying it in virtual time, and drawn."""
