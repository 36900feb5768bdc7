"""`gcs site`: sites as files, checked, converted, their volumes computed, and the report for an authority."""
