"""The extra `plots`: commands that draw need matplotlib, which a minimal installation does not have."""

from importlib.util import find_spec

from gcs.model.errors import ConfigError


def require_matplotlib(what: str) -> None:
    """Check for matplotlib before a command spends time on the flight that it is to draw.

    Args:
        what: the command or option that draws, for the message.

    Raises:
        ConfigError: matplotlib is not installed; the text names the extra.
    """
    if find_spec("matplotlib") is None:
        raise ConfigError(
            f"{what} needs matplotlib, which is not installed; to install it:"
            " pip install 'formation-gcs[plots]'"
        )
