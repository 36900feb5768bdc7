"""YAML to frozen settings, with bounds and line numbers; imports bus, stations and what lies below."""
