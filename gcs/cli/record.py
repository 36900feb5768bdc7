"""The record that a configuration asks for."""

from gcs.config import Config
from gcs.records.record import Record


def make_record(config: Config) -> Record | None:
    """A new session's record, not opened yet; None where the configuration names no folder."""
    if config.record is None:
        return None
    vehicles = {each.id: (each.system_id, link.name) for link in config.links for each in link.fleet}
    return Record(config.record.folder, config.model_dump_json(), vehicles, flight=config.record.flight)
