"""The MAVSDK transport frame by frame: serial ports, TCP, signing and forwarding."""
