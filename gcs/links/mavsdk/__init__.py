"""The MAVSDK transport over UDP: the only package that imports the MAVSDK library."""
