"""One module of HTTP routes per part of the service; they only translate."""
