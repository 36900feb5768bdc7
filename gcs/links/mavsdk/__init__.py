"""The MAVSDK transport: the only package that imports the MAVSDK library."""
