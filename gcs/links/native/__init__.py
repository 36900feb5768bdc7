"""The native transport: our own MAVLink over UDP, for all vehicles of a link at once.

`link` is the `gcs.links.Link`; below it `telemetry` (what the vehicles said), `commands` (one vehicle is told
something and answers), `streams` (which messages come how often), `addresses` (who is where), `packets` (many
datagrams with one system call), `codec` (frames), and `kernels` (what is compiled).
"""
