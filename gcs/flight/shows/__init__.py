"""The selected show: selection, beginning, lights."""
