"""What a link opens and closes on another thread than the loop's: MAVSDK, recording, signing time."""

from threading import Lock

from gcs.links.mavsdk.instances import MavsdkInstances
from gcs.links.signing_keys import Signing
from gcs.links.tlog import Recorder


class LinkThread:
    """One run of a link. A thread cannot be cancelled, so `close` waits for `open`, or prevents it."""

    def __init__(self, fleet: MavsdkInstances, recorder: Recorder | None, signing: Signing | None) -> None:
        """Nothing is opened yet."""
        self._fleet = fleet
        self._recorder = recorder
        self._signing = signing
        self._lock = Lock()
        self._closed = False

    def open(self) -> None:
        """Signing first: nothing leaves unsigned. Blocks. Raises: LinkError."""
        with self._lock:
            if self._closed:
                return
            if self._signing is not None:
                self._signing.open()
            if self._recorder is not None:
                self._recorder.open()
            self._fleet.open()

    def close(self) -> None:
        """End the senders first, so that the last frames are also recorded. Blocks."""
        with self._lock:
            self._closed = True
            self._fleet.destroy()
            if self._recorder is not None:
                self._recorder.close()
            if self._signing is not None:
                self._signing.close()
