"""Tutorials, done as they are written: each file, each command, each output."""

import os
import re
import shlex
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from kit.free_port import free_port
from kit.process import COMMAND, PATIENCE, preparations

DOCS = Path(__file__).parents[2] / "docs"
PAGES = [
    pytest.param(page, marks=pytest.mark.needs("mbpoll") if "$ mbpoll " in page.read_text(encoding="utf-8") else ())
    for page in sorted(DOCS.glob("tutorials/*.md"))
]
_BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_FILE = re.compile(r"# (\S+\.toml)\n")
_PROMPT = re.compile(r"^\$ (.*)\n", re.MULTILINE)
#: In an output: anything, in a line or of lines.
_ANYTHING = "..."
#: What runs until it is stopped.
_ENDLESS = ("modbus-gateway simulate ", "modbus-gateway run ", "modbus-gateway read meter -i ")
#: What is typed again if it is too early: a unit is asked once, and may have been late; a trend takes seconds to begin.
_AGAIN = ("modbus-gateway scan ", "modbus-gateway ask ")


class Step(NamedTuple):
    """A file to be written (`shell` is empty), or a command and what it prints."""

    shell: str
    file: str
    text: str


def steps(page: str) -> Iterator[Step]:
    """What somebody does who reads the page."""
    for kind, block in _BLOCK.findall(page):
        if kind == "toml" and (name := _FILE.match(block)):
            yield Step("", name[1], block)
        elif kind == "console":
            _, *parts = _PROMPT.split(block)
            yield from (Step(shell, "", text) for shell, text in zip(parts[::2], parts[1::2], strict=True))


def looks_like(expected: str) -> re.Pattern[str]:
    """What an output must be, whose varying parts are written as `...`."""
    lines = [
        r"(?:.*\n)*?" if line == _ANYTHING else ".*".join(map(re.escape, line.split(_ANYTHING))) + r"\s*\n"
        for line in expected.splitlines()
    ]
    return re.compile("".join(lines))


#: What commands say of a device that a busy machine made late: ours through a gateway and without one, and mbpoll.
_LATE = ("exception 0B", "no response; the limit is", "did not answer", "Target device failed to respond", "timed out")


class Reader:
    """Does what a page says, in `folder`."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._left: list[subprocess.Popen[bytes]] = []
        program = folder / "bin" / "modbus-gateway"
        program.parent.mkdir()
        command = preparations[-1].command if preparations else COMMAND
        program.write_text(f'#!/bin/sh\nexec {shlex.join(command)} "$@"\n')
        program.chmod(0o755)
        own = {name: str(folder) for name in ("RUNTIME_DIRECTORY", "STATE_DIRECTORY")}
        self._env = {**os.environ, **own, "PATH": f"{program.parent}:{os.environ['PATH']}", "COLUMNS": "200"}

    def do(self, step: Step) -> None:
        """Do one step; what runs on is left running."""
        if not step.shell:
            file = self._folder / step.file
            file.parent.mkdir(exist_ok=True)
            file.write_text(step.text)
        elif step.shell.startswith(_ENDLESS):
            self._leave_running(step)
        else:
            said, until = self._said(step.shell), time.monotonic() + PATIENCE
            while step.shell.startswith(_AGAIN) and not looks_like(step.text).fullmatch(said):
                assert time.monotonic() < until, said
                said = self._said(step.shell)
            assert looks_like(step.text).fullmatch(said), said

    def _said(self, shell: str) -> str:
        """What a command prints; again when a simulated device was late, as it is on a busy machine."""
        until = time.monotonic() + PATIENCE
        while True:
            done = subprocess.run(
                shell,
                shell=True,
                cwd=self._folder,
                env=self._env,
                capture_output=True,
                text=True,
                timeout=PATIENCE,
                check=False,
            )
            if done.returncode == 0:
                return done.stdout
            assert any(each in done.stderr + done.stdout for each in _LATE), done
            assert time.monotonic() < until, done.stderr

    def _leave_running(self, step: Step) -> None:
        output = self._folder / f"output-{len(self._left)}"
        with output.open("wb") as its_output:
            self._left.append(
                subprocess.Popen(
                    shlex.split(step.shell), cwd=self._folder, env=self._env, stdout=its_output, stderr=its_output
                )
            )
        until = time.monotonic() + PATIENCE
        while not looks_like(step.text).match(output.read_text()):
            assert time.monotonic() < until, output.read_text()
            assert self._left[-1].poll() is None, output.read_text()
            time.sleep(0.05)

    def end(self) -> None:
        """End what was left running."""
        for process in reversed(self._left):
            process.terminate()
            process.wait(PATIENCE)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: f"{page.parent.name}/{page.stem}")
def test_it_can_be_done_as_it_is_written(page: Path, tmp_path: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for port in sorted(set(re.findall(r":(50\d\d|8502)", text))):
        text = text.replace(port, str(free_port()))
    text = text.replace("/tmp/", f"{tmp_path}/")
    reader = Reader(tmp_path)
    try:
        for step in steps(text):
            reader.do(step)
    finally:
        reader.end()
