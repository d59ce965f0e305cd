"""Runs commands side by side: on each core one that computes, and beside them those that mostly wait."""

import asyncio
import os
import signal
import sys
from asyncio.subprocess import STDOUT
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from time import monotonic


@dataclass(frozen=True)
class Job:
    """A command. Its output comes when all jobs have ended, in their order."""

    name: str
    command: Sequence[str]
    #: It begins when the job of this name has ended.
    after: str = ""
    #: It begins at once, and before those that compute.
    waits: bool = False
    #: Its output comes as it goes.
    live: bool = False
    #: When it fails, whatever runs is ended: nothing else is worth waiting for.
    decides: bool = False


class DecidedError(Exception):
    """A job that decides has failed."""


def side_by_side(jobs: Sequence[Job], logs: Path) -> list[str]:
    """Run them, those that compute in their order; return the names of those that have not passed."""
    logs.mkdir(parents=True, exist_ok=True)
    run = _Run(jobs, logs)
    asyncio.run(run.all())
    run.show()
    return [job.name for job in jobs if not run.passed.get(job.name)]


class _Run:
    def __init__(self, jobs: Sequence[Job], logs: Path) -> None:
        self.passed: dict[str, bool] = {}
        self._jobs = jobs
        self._logs = logs
        self._cores = asyncio.Semaphore(os.cpu_count() or 1)
        self._ended = {job.name: asyncio.Event() for job in jobs}

    async def all(self) -> None:
        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, asyncio.current_task().cancel)
        try:
            async with asyncio.TaskGroup() as group:
                for job in self._jobs:
                    group.create_task(self._do(job))
        except* DecidedError:
            pass

    def show(self) -> None:
        for job in self._jobs:
            if job.name in self.passed and not job.live:
                _say(f"{job.name}:")
                print(self._log(job).read_text(encoding="utf-8", errors="replace"), flush=True)

    async def _do(self, job: Job) -> None:
        if job.after:
            await self._ended[job.after].wait()
        async with nullcontext() if job.waits else self._cores:
            began = monotonic()
            self.passed[job.name] = passed = await self._status(job) == 0
        _say(f"{job.name}: {'passed' if passed else 'FAILED'} after {monotonic() - began:.0f} s")
        self._ended[job.name].set()
        if job.decides and not passed:
            raise DecidedError

    async def _status(self, job: Job) -> int:
        command = job.command if job.waits else ("nice", "-n", "10", *job.command)
        with self._log(job).open("wb") as log:
            output = None if job.live else log
            process = await asyncio.create_subprocess_exec(*command, stdout=output, stderr=STDOUT if output else None)
            try:
                return await process.wait()
            finally:
                if process.returncode is None:
                    process.terminate()
                    await process.wait()

    def _log(self, job: Job) -> Path:
        return self._logs / f"{job.name.replace(',', '').replace(' ', '-')}.log"


def _say(text: str) -> None:
    print(f"side by side: {text}", file=sys.stderr, flush=True)
