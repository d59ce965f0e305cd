"""Whether somebody has opened or closed a device file, told by the kernel (inotify(7)).

The descriptor of a pseudo-terminal's master says only whether somebody has the other end open now. That one program has
closed it and the next one opened it is not seen there if both happen between two looks.
"""

import os
import struct
from typing import Final, Literal

from gateway.clock.threads import ThreadPerCall

_WRITTEN: Final = 0x02
_OPENED: Final = 0x20
_CLOSED: Final = 0x08 | 0x10
#: The kernel has dropped events.
_OVERFLOW: Final = 0x4000
#: `struct inotify_event`: watch, events, cookie, and the length of a name, which the event of a file has not.
_EVENT: Final = struct.Struct("=iIII")
_READ_SIZE: Final = 256 * _EVENT.size

#: Whether somebody has closed it, and somebody had written to it before that.
Closing = Literal["written", "unwritten"] | None


class Closings:
    """Watches from now on whether the device file at `path` is closed, and was written to before that.

    A closing is told before anybody else can notice it, and after all that was written. Who has written is not told.
    Whether it `was_opened` is told up to the last look.

    Raises:
        OSError: the file does not exist, or there are too many watches.
    """

    def __init__(self, path: str) -> None:
        import ctypes  # noqa: PLC0415 - few gateways have a virtual port

        libc = ctypes.CDLL(None, use_errno=True)
        self.was_opened = False
        self._is_written = False
        #: Readable after an opening, a writing or a closing, until `look`.
        self.descriptor: int = libc.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
        if (
            self.descriptor < 0
            or libc.inotify_add_watch(self.descriptor, os.fsencode(path), _OPENED | _WRITTEN | _CLOSED) < 0
        ):
            number = ctypes.get_errno()
            self.close()
            raise OSError(number, os.strerror(number), path)

    def look(self) -> Closing:
        """Return what has happened since the last look."""
        found: Closing = None
        while True:
            try:
                told = os.read(self.descriptor, _READ_SIZE)
            except BlockingIOError:
                return found
            for _, events, _, _ in _EVENT.iter_unpack(told):
                self.was_opened |= bool(events & (_OPENED | _OVERFLOW))
                self._is_written |= bool(events & (_WRITTEN | _OVERFLOW))
                if events & (_CLOSED | _OVERFLOW):
                    found = "written" if self._is_written else found or "unwritten"

    def forget(self) -> None:
        """Forget what was written up to the last look."""
        self._is_written = False

    def close(self) -> None:
        """End the watch; the kernel takes some 20 ms for that, and sometimes far longer, so it is done in a thread."""
        if self.descriptor >= 0:
            ThreadPerCall("end of a watch").submit(os.close, self.descriptor)
            self.descriptor = -1
