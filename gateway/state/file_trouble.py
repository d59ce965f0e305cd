"""Tells that a file is not written."""

from gateway.events import Emit, StateKeptAgain, StateNotKept


class FileTrouble:
    """Why a file, or a folder, is not written: an event tells when that begins, and when it ends."""

    def __init__(self, file: object, emit: Emit) -> None:
        self._file = str(file)
        self._emit = emit
        #: Empty while it is written.
        self.reason = ""

    def tell(self, reason: str) -> None:
        """Note why it is not written now, or with an empty reason that it is."""
        if reason and not self.reason:
            self._emit(StateNotKept(self._file, reason))
        if self.reason and not reason:
            self._emit(StateKeptAgain(self._file))
        self.reason = reason

    def failed(self, error: BaseException) -> None:
        """Note the error that keeps it from being written, which may have no text."""
        self.tell(getattr(error, "strerror", None) or str(error) or type(error).__name__)
