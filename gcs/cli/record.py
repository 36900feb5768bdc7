"""Creates the record of a configuration, and finds the sessions of an existing one."""

import logging
from pathlib import Path

from gcs.config.schema import Config
from gcs.model.errors import GcsError
from gcs.recording.audit_reader import AUDIT, exclusions, interruption, last_known
from gcs.recording.session import Record

log = logging.getLogger(__name__)


def make_record(config: Config) -> Record | None:
    """Make a new session's record, not opened yet; None when the configuration has no folder."""
    if config.record is None:
        return None
    vehicles = {each.id: (each.system_id, link.name) for link in config.links for each in link.fleet}
    try:
        found, excluded = interruption(config.record.folder), exclusions(config.record.folder)
    except GcsError as error:  # a damaged record must not prevent a flight
        log.error("record_unread", extra={"cause": str(error)})
        found, excluded = None, {}
    return Record(
        config.record.folder,
        config.model_dump_json(),
        vehicles,
        flight=config.record.flight,
        found=found,
        excluded=excluded,
    )


def session_folder(folder: Path) -> Path:
    """Return the folder of a record's newest session, else `folder`. Raises: GcsError for a bad audit."""
    if not (folder / AUDIT).is_file():
        return folder
    session = last_known(folder).session
    return folder if session is None else folder / session.id
