"""Processes of the gateway's command that need not import it: they are forked off one that has imported all of it.

    with Preparation("any-name") as preparation:
        process = preparation.start(["run", "gateway.toml"], stderr=subprocess.PIPE)

A start takes a tenth of the time that Python needs otherwise. From `gateway.cli.main.main` on a process does at its
start what others do, but for two things: the tables of the config are built already, and what is imported is not looked
through for garbage. Tests of what comes before start one anew. The processes in which a gateway reads its config, and
the simulators of a demo, are forked off too.
"""

import asyncio.unix_events
import atexit
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
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, suppress
from functools import partial
from pathlib import Path
from struct import Struct
from types import ModuleType, SimpleNamespace
from typing import Any, Self

#: The longest request, in bytes.
_LONGEST = 1 << 18
#: A process's number or exit code.
_NUMBER = Struct("i")
#: How long whoever wants it waits for the process that imports everything, and it for him, in seconds.
_STARTING_TIME = 60.0


class PreparedProcess:
    """A process as `subprocess.Popen` has them, as far as tests ask."""

    def __init__(
        self,
        control: socket.socket,
        words: Sequence[str],
        env: Mapping[str, str],
        outputs: Sequence[int],
        *,
        program: str = "command",
    ) -> None:
        self._status, theirs = socket.socketpair()
        request = {"program": program, "words": [*words], "env": {**env}, "folder": str(Path.cwd())}
        with theirs:
            socket.send_fds(control, [json.dumps(request).encode()], [*outputs, theirs.fileno()])
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
    """The process that has imported everything, one for all workers of the test run. It ends with the last of them."""

    def __init__(self, name: str) -> None:
        self._address = f"\0prepared {name}"

    def __enter__(self) -> Self:
        while True:
            try:
                self._control = _connected(self._address)
            except ConnectionRefusedError:
                own = os.environ | {"PYDANTIC_DISABLE_PLUGINS": "__all__"}  # as the command does
                words = [sys.executable, "-P", __file__, self._address[1:]]
                subprocess.run(words, stdin=subprocess.DEVNULL, env=own, timeout=_STARTING_TIME, check=True)
            else:
                return self

    def __exit__(self, *_: object) -> None:
        self._control.close()

    @property
    def command(self) -> list[str]:
        """What does in a shell what `modbus-gateway` does."""
        return [sys.executable, "-I", "-S", str(Path(__file__).with_name("prepared_command.py")), self._address[1:]]

    def start(
        self, words: Sequence[str], env: Mapping[str, str] | None = None, *, stdout: int = 1, stderr: int = 2
    ) -> PreparedProcess:
        """`modbus-gateway WORDS`, which writes to these descriptors."""
        return PreparedProcess(self._control, words, os.environ if env is None else env, (stdout, stderr))


def _connected(address: str) -> socket.socket:
    control = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        control.connect(address)
    except OSError:
        control.close()
        raise
    return control


class _Parent:
    """What forks: `serve` returns in each child, with what it shall do."""

    def __init__(self, door: socket.socket) -> None:
        self._selector = selectors.DefaultSelector()
        self._selector.register(door, selectors.EVENT_READ, self._accept)
        self._door = door
        self._controls: set[socket.socket] = set()
        self._running: dict[int, socket.socket] = {}

    def serve(self) -> Callable[[], int] | None:
        """What a child has to do; None in the parent, once nobody is left to ask for more."""
        while True:
            for key, _ in self._selector.select(_STARTING_TIME):
                if task := key.data():
                    return task
            if not self._controls:
                for pid in self._running:  # a gateway whose test was killed would open the ports of others
                    os.kill(pid, signal.SIGKILL)
                return None

    def _accept(self) -> None:
        control, _ = self._door.accept()
        self._controls.add(control)
        self._selector.register(control, selectors.EVENT_READ, lambda: self._take(control))

    def _take(self, control: socket.socket) -> Callable[[], int] | None:
        asked, descriptors, _, _ = socket.recv_fds(control, _LONGEST, 3)
        if asked:
            return self._fork(json.loads(asked), descriptors)
        self._selector.unregister(control)
        self._controls.remove(control)
        control.close()
        return None

    def _fork(self, request: dict[str, Any], descriptors: list[int]) -> Callable[[], int] | None:
        pid = os.fork()
        if pid == 0:
            self._close()
            _become(request, descriptors)
            return partial(_PROGRAMS[request["program"]], request["words"])
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
        for each in (*self._running.values(), *self._controls, self._door, self._selector):
            each.close()


def _become(request: dict[str, Any], descriptors: list[int]) -> None:
    """Be as if just started."""
    for number, output in enumerate(descriptors[:2], 1):
        os.dup2(output, number)
    for each in descriptors:
        os.close(each)
    os.environ.clear()
    os.environ.update(request["env"])
    os.chdir(request["folder"])
    signal.signal(signal.SIGINT, signal.default_int_handler)
    random.seed()


def _run_command(words: Sequence[str]) -> int:
    from gateway.cli import main  # noqa: PLC0415 - of those that only start processes nobody needs it
    from gateway.readconfig import process as config_process  # noqa: PLC0415
    from gateway.runtime import garbage  # noqa: PLC0415

    _replace(config_process, subprocess, Popen=_start_reader)
    _replace(asyncio.unix_events, subprocess, Popen=_start_simulator)
    _replace(garbage, gc, unfreeze=_Unfreezing())
    sys.argv[:] = [str(main.__file__), *words]
    return main.main()


def _replace(module: ModuleType, library: ModuleType, **others: Callable[..., Any]) -> None:
    """Let a module find other functions in a library that it has imported."""
    vars(module)[library.__name__] = SimpleNamespace(**vars(library) | others)


class _Unfreezing:
    """`gc.unfreeze`, but not at the start: to look through all that is imported takes longer than the rest of it."""

    def __init__(self) -> None:
        self._has_started = False

    def __call__(self) -> None:
        if self._has_started:
            gc.unfreeze()
        self._has_started = True


class _Reader(PreparedProcess):
    """What reads a config, as `subprocess.Popen` starts it for config_process."""

    def __init__(self, words: Sequence[str], **_: Any) -> None:
        *_, file, kind, _ = words
        (out, its_out), (err, its_err) = os.pipe(), os.pipe()
        try:
            with closing(_connected(_parents[0])) as control:
                super().__init__(control, [file, kind], os.environ, [its_out, its_err], program="config")
        finally:
            os.close(its_out)
            os.close(its_err)
        self.stdin, self.stdout, self.stderr = None, os.fdopen(out, "rb"), os.fdopen(err, "rb")

    def communicate(self, _given: None = None, *, timeout: float) -> tuple[bytes, bytes]:
        """All that it writes to stdout. `timeout` is in its own hands: it ends a second later."""
        said = self.stdout.read()
        self.wait(timeout)
        return said, b""


def _start_reader(words: Sequence[str], **how: Any) -> Any:
    """What reads a config file; what checks a text is a process as always: it is given one, and then limits itself."""
    return subprocess.Popen(words, **how) if words[-2] == "text" else _Reader(words)


def _read_config(words: Sequence[str]) -> int:
    from gateway.readconfig import reader as config_reader  # noqa: PLC0415

    os.setpgid(0, 0)
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGHUP})
    sys.argv[1:] = words
    config_reader.main()
    return 0


def _start_simulator(words: Sequence[str], **how: Any) -> subprocess.Popen[bytes]:
    """A simulator of a demo, as asyncio starts it: a process of its own, but with what is imported here."""
    others = [each for each in threading.enumerate() if not each.name.removeprefix("asyncio-").startswith("waitpid-")]
    if len(others) > 1:  # whoever forks then may hang
        return subprocess.Popen(words, **how)
    return subprocess.Popen(words, preexec_fn=partial(_simulate, words), **how)  # noqa: PLW1509 - threads only wait


def _simulate(words: Sequence[str]) -> None:
    """Run between fork and exec, which never comes."""
    from gateway.cli import main  # noqa: PLC0415

    os.closerange(3, 1 << 16)  # one is open until another program is executed, and subprocess waits for that
    signal.set_wakeup_fd(-1)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    sys.stdout = os.fdopen(1, "w", closefd=False)  # what is still in the other one the demo prints
    try:
        _leave(main.main(words[words.index("simulate") :]))
    except BaseException:  # noqa: BLE001 - as at the end of a program
        traceback.print_exc()
        os._exit(1)


def _import_everything() -> None:
    import gateway  # noqa: PLC0415

    for module in pkgutil.walk_packages(gateway.__path__, "gateway."):
        with suppress(ModuleNotFoundError):  # a library that is needed for some tables of the config only
            importlib.import_module(module.name)


def _build_tables() -> None:
    """Build what a process builds when it first meets a table in a config: half of the time to read a config."""
    from gateway.config.schema.table import Table  # noqa: PLC0415

    tables = Table.__subclasses__()
    for table in tables:  # those that are added, too
        tables += table.__subclasses__()
        table.model_rebuild()


def _leave(code: int) -> None:
    """End as a program does, but leave what it has imported as it is: to take that apart costs 40 ms."""
    vars(threading)["_shutdown"]()
    vars(atexit)["_run_exitfuncs"]()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def prepare(name: str) -> None:
    """Be the process that has imported everything, in the background, unless another one is it already."""
    address = f"\0{name}"
    door = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        door.bind(address)
    except OSError:
        return
    door.listen(128)
    if os.fork():
        os._exit(0)
    os.setsid()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _parents.append(address)
    _import_everything()
    _build_tables()
    gc.collect()
    gc.freeze()
    if task := _Parent(door).serve():
        _leave(task())


#: The address of the process that has imported everything, in itself and in all that it forks off.
_parents: list[str] = []
_PROGRAMS = {"command": _run_command, "config": _read_config}

if __name__ == "__main__":
    prepare(sys.argv[1])
