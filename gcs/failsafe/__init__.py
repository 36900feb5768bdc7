"""Failsafes: settings (`policy`), requests (`triggers`), which of them is flown (`arbitration`); pure."""
