"""YAML to frozen settings, with bounds and lines. A section's class is in the package that uses it."""
