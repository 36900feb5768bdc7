"""`gcs demo`: the whole story, with an embedded fake fleet."""
