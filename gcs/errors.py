"""Every error this package raises on purpose.

GcsError
├── ShapeError       an array has the wrong shape (a bug in the caller)
├── ConfigError      a configuration file says something impossible
├── InvalidError     a value from outside is out of range; names the field and what is allowed
├── AccessError      the caller may not do this, or calls too often
├── RefusedError     a proper request at the wrong moment; says why
├── UnknownError     a vehicle, obstacle or order that does not exist
└── LinkError        a transport does not work; the supervisor retries
    └── OrderError   a vehicle refused an order or did not answer
"""


class GcsError(Exception):
    """Root of the tree; its text is meant for a person."""


class ShapeError(GcsError):
    """An array does not fit its fleet."""


class ConfigError(GcsError):
    """A configuration that cannot be flown; the text names file and key."""


class InvalidError(GcsError):
    """A value that can never be accepted.

    Attributes:
        field: dotted name as the caller knows it, for example ``radius_m``.
        value: what was given.
        allowed: what would be right, in words or numbers, units included.
    """

    def __init__(self, field: str, value: object, allowed: str) -> None:
        super().__init__(f"{field} = {value}: {allowed}")
        self.field = field
        self.value = value
        self.allowed = allowed


class AccessError(GcsError):
    """The caller's token does not allow it, or it called too often; the text says what would."""


class RefusedError(GcsError):
    """A request that is proper but not now; the text says why and what to do."""


class UnknownError(GcsError):
    """Something named does not exist."""


class LinkError(GcsError):
    """A transport failed; whoever supervises the link retries."""


class OrderError(LinkError):
    """A vehicle refused an order, or its obedience was not seen in time."""
