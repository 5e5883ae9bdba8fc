"""What the log says of work that is done again and again and fails, because the Repository is away for example."""

from __future__ import annotations

import logging
from types import TracebackType

from somrs.errors import RemoteError

log = logging.getLogger(__name__)


class Outage:
    """The context in which a device does such work. A RemoteError ends the work of this time only.

    The log says once that the device cannot do it, and once that it can again.
    """

    def __init__(self, device: str, work: str) -> None:
        self._device, self._work = device, work
        self._lasts = False

    def __enter__(self) -> None:
        """Begin the work of this time."""

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> bool:
        if isinstance(error, RemoteError):
            if not self._lasts:
                log.warning("%s cannot %s: %s", self._device, self._work, error)
            self._lasts = True
            return True
        if error is None and self._lasts:
            log.warning("%s can %s again", self._device, self._work)
            self._lasts = False
        return False
