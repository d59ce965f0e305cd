"""A command for shells in place of `modbus-gateway`: done by a process that is prepared, see kit/prepared.py.

    python -I -S prepared_command.py ADDRESS WORDS...

It imports little, as it is what starts. Signals that end it go to that process, whose exit code it has.
"""

import json
import os
import signal
import socket
import struct
import sys

_NUMBER = struct.Struct("i")


def main(address: str, words: list[str]) -> int:
    """Have it done; the exit code, or that of a shell for the signal that has ended it."""
    status, theirs = socket.socketpair()
    request = {"program": "command", "words": words, "env": {**os.environ}, "folder": os.getcwd()}  # noqa: PTH109
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as control, theirs:
        control.connect(address)
        socket.send_fds(control, [json.dumps(request).encode()], [1, 2, theirs.fileno()])
        (process,) = _NUMBER.unpack(status.recv(_NUMBER.size))
    for number in (signal.SIGHUP, signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: os.kill(process, number))
    (code,) = _NUMBER.unpack(status.recv(_NUMBER.size))
    return code if code >= 0 else 128 - code


if __name__ == "__main__":
    sys.exit(main(f"\0{sys.argv[1]}", sys.argv[2:]))
