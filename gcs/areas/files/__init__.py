"""Files of sites: GeoJSON, KML and QGroundControl's plans, read and written; readers trust no file."""
