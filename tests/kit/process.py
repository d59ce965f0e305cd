"""The gateway as a process of its own, as an operator starts it."""

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import Empty, Queue
from tempfile import TemporaryFile
from typing import Any, Self

from kit.prepared import Preparation, PreparedProcess

#: How long a process may take for anything, in seconds. Real machines are slow at times.
PATIENCE = 120.0

#: Comes after the last event of a process.
_ENDED = "the process has ended"

COMMAND = [sys.executable, "-P", "-m", "gateway.cli.main"]


#: What starts processes quickly, if the tests have one; COMMAND does otherwise.
preparations: list[Preparation] = []


@contextmanager
def prepared(run: str) -> Iterator[None]:
    """In its context a gateway and a command that is run to its end are forked off one that has imported everything.

    It is one for all workers of this test run.
    """
    with Preparation(run) as preparation:
        preparations.append(preparation)
        try:
            yield
        finally:
            preparations.remove(preparation)


@contextmanager
def started_anew() -> Iterator[None]:
    """In its context each process is started by the system, for tests of what comes before the command."""
    kept = [*preparations]
    preparations.clear()
    try:
        yield
    finally:
        preparations.extend(kept)


def command(*words: str, env: Mapping[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    """Run `modbus-gateway WORDS` to its end."""
    if not preparations:
        whole = [*COMMAND, *words]
        return subprocess.run(whole, capture_output=True, text=True, timeout=PATIENCE, check=False, env=env)
    with TemporaryFile() as out, TemporaryFile() as err:
        process = preparations[-1].start(words, env, stdout=out.fileno(), stderr=err.fileno())
        try:
            code = process.wait(PATIENCE)
        finally:
            process.kill()
        said = [os.pread(file.fileno(), os.fstat(file.fileno()).st_size, 0).decode() for file in (out, err)]
    sys.stderr.write(said[1])  # shown when the test fails
    return subprocess.CompletedProcess([*COMMAND, *words], code, *said)


def started(
    words: Sequence[str | Path], env: Mapping[str, str] | None = None, *, stdout: int = 1, stderr: int = 2
) -> subprocess.Popen[bytes] | PreparedProcess:
    """`modbus-gateway WORDS`, which writes to these descriptors."""
    if preparations:
        return preparations[-1].start([*map(str, words)], env, stdout=stdout, stderr=stderr)
    return subprocess.Popen([*COMMAND, *words], stdout=stdout, stderr=stderr, env=env)


@contextmanager
def simulated(port: Path, *words: str) -> Iterator[None]:
    """`modbus-gateway simulate` on a port; it takes the port away in the end, as in system.test_simulate."""
    said, its_output = os.pipe()
    try:
        process = started(["simulate", *words, "--port", port], stdout=its_output)
    finally:
        os.close(its_output)
    with os.fdopen(said) as output:
        try:
            assert output.readline()
            yield
            process.terminate()
            process.wait(PATIENCE)
        finally:
            process.kill()
            process.wait()


class GatewayProcess:
    """`modbus-gateway run` with a config; in its context it is ready. `log` holds its events, `rest` other lines.

    `port` is that of the first listener, `ports` are those of all by what is spoken there: `rtu+tcp`.
    """

    def __init__(self, folder: Path, config: str, *, level: str = "debug") -> None:
        self.config = folder / "gateway.toml"
        self.config.write_text(f'{config}\n[log]\nformat = "json"\nlevel = "{level}"\n')
        self.log: list[dict[str, Any]] = []
        self.rest: list[str] = []
        self._events: Queue[dict[str, Any]] = Queue()

    def __enter__(self) -> Self:
        folder = str(self.config.parent)  # for a control socket and a state that no other gateway has
        own = {"STATE_DIRECTORY": folder, **os.environ, "RUNTIME_DIRECTORY": folder}
        log, its_log = os.pipe()
        try:
            self._process = started(["run", self.config], own, stderr=its_log)
        finally:
            os.close(its_log)
        self._log = os.fdopen(log)
        self._reader = threading.Thread(target=self._read_log, name="gateway's log")
        self._reader.start()
        try:
            ready = self.wait_for("ready")
        except BaseException:
            self.__exit__()
            raise
        self.ports = {address.partition(":")[0]: int(address.rpartition(":")[2]) for address in ready["listeners"]}
        self.port = int(ready["listeners"][0].rsplit(":", 1)[1])
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        self._reader.join()
        self._log.close()

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def descriptors(self) -> int:
        """How many it has open."""
        return len(list(Path(f"/proc/{self.pid}/fd").iterdir()))

    def memory(self, *, most: bool = False) -> int:
        """How much of it is resident, in KiB; `most`: the most since it was last asked without it."""
        if not most:
            Path(f"/proc/{self.pid}/clear_refs").write_text("5")
        status = Path(f"/proc/{self.pid}/status").read_text()
        return int(status.split("VmHWM:")[1].split()[0])

    def wait_for(self, event: str, patience: float = PATIENCE) -> dict[str, Any]:
        """The next event of this name, if there are `patience` seconds at most between events."""
        while True:
            with suppress(Empty):
                found = self._events.get(timeout=patience)
                if found["event"] == event:
                    return found
                if found["event"] != _ENDED:
                    continue
            raise AssertionError(f"no event {event}; log: {self.log}, {self.rest}")

    def first(self, event: str) -> dict[str, Any]:
        """The first event of this name since the start, also one from before `ready`."""
        return next((each for each in list(self.log) if each["event"] == event), None) or self.wait_for(event)

    def signal(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def stop(self) -> int:
        """SIGTERM; the exit code."""
        self.signal(signal.SIGTERM)
        return self.wait()

    def wait(self) -> int:
        """The exit code, once it has ended and all of its log has been read."""
        code = self._process.wait(PATIENCE)
        self._reader.join()
        return code

    def _read_log(self) -> None:
        for line in self._log:
            try:
                event = json.loads(line)
            except ValueError:
                self.rest.append(line)
                continue
            self.log.append(event)
            self._events.put(event)
        self._events.put({"event": _ENDED})
