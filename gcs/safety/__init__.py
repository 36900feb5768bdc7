"""The last word before sending. Pure; only shrinks or deflects, and fails closed."""
