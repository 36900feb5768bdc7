"""The selected show: selection and beginning."""
