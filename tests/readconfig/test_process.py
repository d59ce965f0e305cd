"""A config is read in a process of its own, which hands over the same as if it was read here."""

import os
import pickle
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from gateway.errors import ConfigError
from gateway.readconfig import process
from gateway.readconfig.process import ConfigProcess, ConfigRead, read_config
from gateway.readconfig.reader import packed, read_here
from gateway.version import __version__
from kit.process import PATIENCE

EXAMPLES = sorted(Path("deploy/examples").glob("*.toml"))

NOTHING = ConfigRead(None, ())


@pytest.fixture(autouse=True)
def _on_a_busy_machine(monkeypatch):
    monkeypatch.setattr(process, "_ENDING_TIME", PATIENCE)


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_a_plan_is_packed_as_it_is(file):
    read = read_here(file)
    assert read.plan is not None
    assert pickle.loads(packed(read)) == read


def test_a_plan_is_handed_over_as_it_is():
    file = max(EXAMPLES, key=lambda file: file.stat().st_size)
    assert read_config(file) == read_here(file)


def test_problems_come_with_their_words(tmp_path):
    file = tmp_path / "gateway.toml"
    file.write_text('[[line]]\nport = "/dev/ttyUSB0"\nbaud = 17\nspeed = 3\n')
    read = read_config(file)
    assert read.plan is None
    assert read.errors == read_here(file).errors != ()
    assert read.text == file.read_text()


def test_what_check_says_of_other_files_comes_if_it_is_asked_for(tmp_path):
    file = tmp_path / "gateway.toml"
    file.write_text(
        '[[image]]\nunit = 1\nholding = 8\n[web]\nbind = "http://127.0.0.1:8502"\nusers = "/nowhere/users"\n'
    )
    assert "there is no file /nowhere/users" in str(read_config(file, look_around=True).problems)
    assert "there is no file" not in str(read_config(file).problems)


def test_a_file_that_takes_too_long_is_given_up_and_so_is_the_process(tmp_path, monkeypatch):
    _fake(monkeypatch, tmp_path, "exec sleep 100")
    monkeypatch.setattr(process, "READING_TIME", 0.5)
    reading = ConfigProcess(tmp_path / "gateway.toml")
    with pytest.raises(ConfigError, match=r"gateway.toml: cannot be read within 0.5 s; is its disk there\?"):
        reading.result()
    assert reading._process._process.returncode == -signal.SIGKILL


def test_it_ends_with_the_wait_for_it(tmp_path, monkeypatch):
    _fake(monkeypatch, tmp_path, "exec sleep 100")
    reading = ConfigProcess(tmp_path / "gateway.toml")
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)  # as Ctrl-C at the start
    try:
        signal.setitimer(signal.ITIMER_REAL, 1.0)
        with pytest.raises(KeyboardInterrupt):
            reading.result()
    finally:
        signal.signal(signal.SIGALRM, before)
    assert reading._process._process.returncode == -signal.SIGKILL


def test_a_hang_up_that_is_meant_for_the_gateway_does_not_end_it(tmp_path):
    file = tmp_path / "gateway.toml"
    file.write_text("[[image]]\nunit = 1\nholding = 8\n")
    reading = ConfigProcess(file)
    os.kill(reading._process._process.pid, signal.SIGHUP)
    assert reading.result().plan is not None
    assert signal.SIGHUP not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def _fake(monkeypatch, folder: Path, script: str) -> None:
    program = folder / "python"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(program))


def test_it_keeps_what_it_compiles_where_we_do(tmp_path, monkeypatch):
    _fake(monkeypatch, tmp_path, f'echo "$@" > {tmp_path}/words; exit 1')
    monkeypatch.setattr(sys, "pycache_prefix", "/var/bytecode")
    with pytest.raises(ConfigError):
        read_config(tmp_path / "gateway.toml")
    assert " -X pycache_prefix=/var/bytecode " in (tmp_path / "words").read_text()


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("kill -KILL $$", "the process that reads it was ended by SIGKILL; is memory short?"),
        ("kill -40 $$", "the process that reads it was ended by signal 40; is memory short?"),
        ("echo why; echo MemoryError >&2; exit 3", "the process that reads it has failed with status 3: MemoryError"),
        ("exit 1", "the process that reads it has failed with status 1"),
    ],
)
def test_a_process_that_dies_is_a_sentence(monkeypatch, tmp_path, script, reason):
    _fake(monkeypatch, tmp_path, script)
    with pytest.raises(ConfigError) as caught:
        read_config(Path("/etc/gateway.toml"))
    assert str(caught.value) == f"/etc/gateway.toml was not read: {reason}"


def test_what_another_version_of_the_gateway_would_read_is_not_taken_over(monkeypatch):
    monkeypatch.setattr(process, "_PROGRAM", process._PROGRAM.replace(repr(__version__), "'0.0.1'"))
    with pytest.raises(ConfigError, match="failed with status 1: modbus-gateway has been changed since its start"):
        read_config(Path("/etc/gateway.toml"))


@pytest.mark.parametrize(
    "answer",
    [
        b"hello\n" + packed(NOTHING),
        packed(NOTHING)[:-9],
        packed(NOTHING).replace(b"problems", b"troubles"),
        packed(NOTHING).replace(b"ConfigRead", b"ConfigText"),
    ],
    ids=["printed", "cut", "field", "class"],
)
def test_an_answer_of_other_modules_is_a_sentence(monkeypatch, tmp_path, answer):
    (tmp_path / "answer").write_bytes(answer)
    _fake(monkeypatch, tmp_path, f"cat {tmp_path}/answer")
    with pytest.raises(ConfigError, match="was not read: modbus-gateway has been changed since its start; restart it"):
        read_config(Path("/etc/gateway.toml"))


def test_a_process_that_cannot_be_started_is_a_sentence(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with pytest.raises(ConfigError, match="no process can be started for it: No such file or directory"):
        ConfigProcess(Path("gateway.toml"))


def test_it_does_not_wait_for_ever_when_the_gateway_has_gone():
    slow = (
        "import sys, time\n"
        "from gateway.readconfig import reader\n"
        "reader.READING_TIME = 0.0\n"
        "reader.read_here = lambda *_, **__: time.sleep(150)\n"
        "sys.argv[1:] = ['gateway.toml', 'plan']\n"
        "reader.main()\n"
    )
    ended = subprocess.run([sys.executable, "-c", slow], capture_output=True, check=False, timeout=120)
    assert ended.returncode == -signal.SIGALRM


def test_its_modules_are_those_of_a_path_that_only_the_gateway_has(tmp_path, monkeypatch):
    """As in a zipapp, or where a launcher sets the path."""
    (tmp_path / "answer.py").write_text("answer = 'it has this path'")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(
        process, "_PROGRAM", process._PROGRAM.replace("main()", "import answer; sys.exit(answer.answer)")
    )
    with pytest.raises(ConfigError, match="it has this path"):
        read_config(tmp_path / "gateway.toml")
