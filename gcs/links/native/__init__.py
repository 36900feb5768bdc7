"""The native transport: our own MAVLink over UDP, for all vehicles of a link at once.

`link` is the `gcs.links.Link`; telemetry, commands, stream requests, addresses and sockets are in
`gcs.links.udp`, frames in `gcs.mavlink`.
"""
