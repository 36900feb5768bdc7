"""What a show sends of itself to TAK. `gcs.links.targets` reads what others send."""
