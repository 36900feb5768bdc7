"""`gcs show`: shows as files, checked, drawn, imported, sampled, placed and exported."""
