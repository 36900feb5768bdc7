"""Prints a figure beside what is asked of it."""


def at_least(value: float, limit: float, shown: str = ".1f") -> str:
    """Return the figure, and whether it reaches the limit; `shown` is the format of both."""
    return f"{value:{shown}} (must: >= {limit:{shown}}: {'pass' if value >= limit else 'MISS'})"


def at_most(value: float, limit: float, shown: str = ".1f") -> str:
    """Return the figure, and whether it stays within the limit; `shown` is the format of both."""
    return f"{value:{shown}} (must: <= {limit:{shown}}: {'pass' if value <= limit else 'MISS'})"
