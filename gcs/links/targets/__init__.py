"""Sources of targets: each receives bytes, and yields reports of where a target is.

`receive.keep_receiving(source, take, failed, intake)` runs one source without end, whatever arrives.
"""
