"""Processes of the gateway's command that need not import it: they are forked off one that has imported all of it.

    with Preparation() as preparation:
        process = preparation.start(["run", "gateway.toml"], stderr=subprocess.PIPE)

A start takes a tenth of the time that Python needs otherwise. What a process does at its start is the same from
`gateway.cli.main.main` on; tests of what comes before start one anew. The process in which a gateway reads its config
at the start is forked off too; that of a reload, when the gateway has threads, is a new one.
"""

import gc
import importlib
import json
import os
import pkgutil
import random
import select
import selectors
import signal
import socket
import subprocess
import sys
import threading
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from struct import Struct
from types import SimpleNamespace
from typing import Any, Self

#: The longest request, in bytes.
_LONGEST = 1 << 18
#: A process's number or exit code.
_NUMBER = Struct("i")


class PreparedProcess:
    """A process as `subprocess.Popen` has them, as far as tests ask."""

    def __init__(self, control: socket.socket, words: Sequence[str], env: Mapping[str, str], outputs: Sequence[int]):
        self._status, theirs = socket.socketpair()
        request = json.dumps({"words": [*words], "env": {**env}, "folder": str(Path.cwd())}).encode()
        with theirs:
            socket.send_fds(control, [request], [*outputs, theirs.fileno()])
        self.pid = self._number()
        self.returncode: int | None = None

    def __del__(self) -> None:
        self._status.close()

    def poll(self) -> int | None:
        """The exit code if it has ended. Until it was told, the process stays in the table of processes."""
        if self.returncode is None and select.select([self._status], [], [], 0)[0]:
            self.wait()
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """The exit code, or minus the signal that has killed it.

        Raises:
            TimeoutError: it goes on.
        """
        if self.returncode is None:
            self._status.settimeout(timeout)
            self.returncode = self._number()
            self._status.close()
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send it, unless the process has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """End it at once."""
        self.send_signal(signal.SIGKILL)

    def terminate(self) -> None:
        """Ask it to end."""
        self.send_signal(signal.SIGTERM)

    def _number(self) -> int:
        data = self._status.recv(_NUMBER.size)
        if not data:
            raise RuntimeError("what starts the processes has ended")
        (number,) = _NUMBER.unpack(data)
        return int(number)


class Preparation:
    """The process that has imported everything. It ends with us, whatever becomes of us."""

    def __enter__(self) -> Self:
        self._control, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            words = [sys.executable, "-P", __file__, str(theirs.fileno())]
            own = os.environ | {"PYDANTIC_DISABLE_PLUGINS": "__all__"}  # as the command does
            self._process = subprocess.Popen(words, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL, env=own)
        return self

    def __exit__(self, *_: object) -> None:
        self._control.close()
        self._process.kill()
        self._process.wait()

    def start(
        self, words: Sequence[str], env: Mapping[str, str] | None = None, *, stdout: int = 1, stderr: int = 2
    ) -> PreparedProcess:
        """`modbus-gateway WORDS`, which writes to these descriptors."""
        return PreparedProcess(self._control, words, os.environ if env is None else env, (stdout, stderr))


class _Parent:
    """What forks: `serve` returns in each child, with the words that are its command."""

    def __init__(self, control: socket.socket) -> None:
        self._selector = selectors.DefaultSelector()
        self._selector.register(control, selectors.EVENT_READ)
        self._control = control
        self._running: dict[int, socket.socket] = {}

    def serve(self) -> list[str] | None:
        """The command in a child; None in the parent, once nobody is left to ask for more."""
        while True:
            for key, _ in self._selector.select():
                if key.fileobj is not self._control:
                    key.data()
                    continue
                asked, descriptors, _, _ = socket.recv_fds(self._control, _LONGEST, 3)
                if not asked:
                    return None
                if words := self._fork(json.loads(asked), descriptors):
                    return words

    def _fork(self, request: dict[str, Any], descriptors: list[int]) -> list[str] | None:
        pid = os.fork()
        if pid == 0:
            self._close()
            return _become(request, descriptors)
        *outputs, number = descriptors
        for output in outputs:
            os.close(output)
        status = self._running[pid] = socket.socket(fileno=number)
        status.sendall(_NUMBER.pack(pid))
        ends = os.pidfd_open(pid)
        self._selector.register(ends, selectors.EVENT_READ, lambda: self._tell_end(pid, ends))
        return None

    def _tell_end(self, pid: int, ends: int) -> None:
        """Tell the exit code. Until that has been read nobody else gets the process's number."""
        self._selector.unregister(ends)
        os.close(ends)
        ended = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
        assert ended is not None
        with suppress(OSError):
            exited = ended.si_code == os.CLD_EXITED
            self._running[pid].sendall(_NUMBER.pack(ended.si_status if exited else -ended.si_status))
        self._selector.register(self._running[pid], selectors.EVENT_READ, lambda: self._reap(pid))

    def _reap(self, pid: int) -> None:
        status = self._running.pop(pid)
        self._selector.unregister(status)
        status.close()
        os.waitpid(pid, 0)

    def _close(self) -> None:
        """A child has nothing to do with the others."""
        for key in list(self._selector.get_map().values()):
            if isinstance(key.fileobj, int):
                os.close(key.fileobj)
        for each in (*self._running.values(), self._control, self._selector):
            each.close()


def _become(request: dict[str, Any], descriptors: list[int]) -> list[str]:
    """Be as if just started; the words of the command."""
    for number, output in enumerate(descriptors[:2], 1):
        os.dup2(output, number)
    for each in descriptors:
        os.close(each)
    os.environ.clear()
    os.environ.update(request["env"])
    os.chdir(request["folder"])
    signal.signal(signal.SIGINT, signal.default_int_handler)
    random.seed()
    return [str(word) for word in request["words"]]


def _start_reader(words: Sequence[str], **how: Any) -> subprocess.Popen[bytes]:
    """The process that reads a config, as `subprocess.Popen` starts it, but with what is imported here."""
    if threading.active_count() > 1:  # whoever forks then may hang
        return subprocess.Popen(words, **how)
    *_, file, kind, limit, gateway, _ = words
    read = partial(_read_config, file, kind, limit, gateway)
    return subprocess.Popen(words, preexec_fn=read, **how)  # noqa: PLW1509 - there are no threads


def _read_config(*words: str) -> None:
    from gateway.service import config_reader  # noqa: PLC0415

    os.closerange(3, 1 << 16)  # one is open until another program is executed, and subprocess waits for that
    sys.argv[1:] = words
    try:
        config_reader.main()
        sys.stdout.flush()
    except BaseException:  # noqa: BLE001 - as at the end of a program
        traceback.print_exc()
        os._exit(1)
    os._exit(0)


def _import_everything() -> None:
    import gateway  # noqa: PLC0415 - of those that only start processes nobody needs it

    for module in pkgutil.walk_packages(gateway.__path__, "gateway."):
        with suppress(ModuleNotFoundError):  # a library that is needed for some tables of the config only
            importlib.import_module(module.name)


def _run() -> int:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _import_everything()
    gc.collect()
    gc.freeze()
    words = _Parent(socket.socket(fileno=int(sys.argv[1]))).serve()
    if words is None:
        return 0
    from gateway.cli import main  # noqa: PLC0415
    from gateway.service import config_process  # noqa: PLC0415

    vars(config_process)["subprocess"] = SimpleNamespace(**vars(subprocess) | {"Popen": _start_reader})
    sys.argv[:] = [str(main.__file__), *words]
    return main.main()


if __name__ == "__main__":
    sys.exit(_run())
