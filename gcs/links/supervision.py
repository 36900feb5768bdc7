"""Supervision: keep a link open, whatever happens to it."""

import asyncio
import logging
from collections.abc import MutableMapping

from gcs.links.link import Link
from gcs.model.errors import LinkError

log = logging.getLogger(__name__)

RETRY_S = 0.25  # well below the second after which vehicles in OFFBOARD begin their failsafe
SETTLED_S = 1.0
"""A link that ran this long had worked: its next failure is logged again."""


def leaves(group: BaseExceptionGroup[LinkError]) -> list[LinkError]:
    """The errors within a group, at any depth."""
    inner = [leaves(e) if isinstance(e, BaseExceptionGroup) else [e] for e in group.exceptions]
    return [error for errors in inner for error in errors]


async def keep_open(link: Link, failed_links: MutableMapping[str, str]) -> None:
    """Run a link without end; when it fails, log it once and try again.

    `failed_links` holds the reason, by the link's name, until the link has run for SETTLED_S.
    """
    loop = asyncio.get_running_loop()
    failed = ""
    while True:
        began_s = loop.time()
        settled = loop.call_later(SETTLED_S, failed_links.pop, link.name, None)
        try:
            await link.run()
        except* LinkError as group:  # single, or from a task of the link's own
            cause = "; ".join(str(error) for error in leaves(group))
            if cause != failed or loop.time() - began_s > SETTLED_S:  # it had worked meanwhile
                log.error("link_failed", extra={"link": link.name, "cause": cause})
            failed = failed_links[link.name] = cause
        finally:
            settled.cancel()
        await asyncio.sleep(RETRY_S)
