"""YAML to frozen settings, with bounds and line numbers; imports planning, links and what lies below."""
