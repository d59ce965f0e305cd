"""The program of the process that reads a config: it hands over the plan, and ends. See config_process."""

import os
import pickle
import signal
import sys
import threading
import time
from dataclasses import fields, is_dataclass
from io import BytesIO
from math import ceil
from pathlib import Path
from typing import Any, Final

from gateway.config.load import load
from gateway.config.machine.address_trouble import address_trouble
from gateway.config.resolve import resolve
from gateway.readconfig.process import ANSWER, ConfigRead, remake

#: How often it is looked whether the gateway is still there, in seconds.
_LOOK_EVERY: Final = 0.5


def read_here(file: Path, *, look_around: bool = False) -> ConfigRead:
    """Read `file` in this process. See config_process.ReadConfig."""
    loaded = load(file, address_trouble) if look_around else load(file)
    if look_around:
        from gateway.readconfig.file_troubles import with_file_troubles  # noqa: PLC0415 - it needs TLS, others do not

        loaded = with_file_troubles(loaded, str(file))
    return ConfigRead(None if loaded.config is None else resolve(loaded.config), loaded.problems, loaded.text)


def packed(read: ConfigRead) -> bytes:
    """`read` for another process with the same modules."""
    target = BytesIO()
    _Pickler(target, pickle.HIGHEST_PROTOCOL).dump(read)
    return target.getvalue()


def main() -> None:
    """Read the file, in the way and within the seconds that the arguments say, and write what it says to stdout."""
    file, kind, limit, gateway = sys.argv[1:]
    signal.alarm(ceil(float(limit)) + 1)  # whatever happens: nothing then waits for a file that is none
    threading.Thread(target=_end_with, args=(int(gateway),), name="end with the gateway", daemon=True).start()
    sys.stdout.buffer.write(ANSWER + packed(read_here(Path(file), look_around=kind == "look-around")))


def _end_with(gateway: int) -> None:
    """End this process when the gateway has ended, which has this process number."""
    while os.getppid() == gateway:
        time.sleep(_LOOK_EVERY)
    os._exit(1)


class _Pickler(pickle.Pickler):
    """Takes dataclasses by their fields: those of compiled modules cannot be pickled in the usual way."""

    def reducer_override(self, value: Any) -> Any:
        if is_dataclass(value) and not isinstance(value, type):
            return remake, (type(value), {each.name: getattr(value, each.name) for each in fields(value) if each.init})
        return NotImplemented
