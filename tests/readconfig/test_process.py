"""A config is read in a process of its own, which hands over the same as if it was read here."""

import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from gateway.errors import ConfigError
from gateway.readconfig.process import ANSWER, ConfigProcess, ConfigRead, _handed_over, read_config
from gateway.readconfig.reader import packed, read_here

NOTHING = ConfigRead(None, ())
EXAMPLES = sorted(Path("deploy/examples").glob("*.toml"))


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_a_plan_is_packed_as_it_is(file):
    read = read_here(file)
    assert read.plan is not None
    assert _handed_over(ANSWER + packed(read)) == read


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
    process = ConfigProcess(tmp_path / "gateway.toml", 0.5)
    with pytest.raises(ConfigError, match=r"gateway.toml: cannot be read within 0.5 s; is its disk there\?"):
        process.result()
    assert process._process.wait(60) < 0


def test_a_hang_up_that_is_meant_for_the_gateway_does_not_end_it(tmp_path):
    file = tmp_path / "gateway.toml"
    file.write_text("[[image]]\nunit = 1\nholding = 8\n")
    process = ConfigProcess(file, 120.0)
    os.kill(process._process.pid, signal.SIGHUP)
    assert process.result().plan is not None
    assert signal.SIGHUP not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def _fake(monkeypatch, folder: Path, script: str) -> None:
    program = folder / "python"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(program))


def test_it_keeps_what_it_compiles_where_we_do(tmp_path, monkeypatch):
    _fake(monkeypatch, tmp_path, f'echo "$@" > {tmp_path}/words')
    monkeypatch.setattr(sys, "pycache_prefix", "/var/bytecode")
    with pytest.raises(ConfigError):
        read_config(tmp_path / "gateway.toml")
    assert " -X pycache_prefix=/var/bytecode " in (tmp_path / "words").read_text()


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("kill -KILL $$", "the process that reads it was ended by SIGKILL; is memory short?"),
        ("echo why; echo MemoryError >&2; exit 3", "the process that reads it has failed with status 3: MemoryError"),
        ("exit 1", "the process that reads it has failed with status 1"),
    ],
)
def test_a_process_that_dies_is_a_sentence(monkeypatch, tmp_path, script, reason):
    _fake(monkeypatch, tmp_path, script)
    with pytest.raises(ConfigError) as caught:
        read_config(Path("/etc/gateway.toml"))
    assert str(caught.value) == f"/etc/gateway.toml was not read: {reason}"


@pytest.mark.parametrize(
    "answer",
    [
        b"",
        b"\0config of modbus-gateway 0.0.1\n" + packed(NOTHING),
        ANSWER + packed(NOTHING)[:-9],
        ANSWER + packed(NOTHING).replace(b"problems", b"troubles"),
        ANSWER + packed(NOTHING).replace(b"ConfigRead", b"ConfigText"),
    ],
    ids=["nothing", "version", "cut", "field", "class"],
)
def test_what_another_version_of_the_gateway_has_read_is_not_taken_over(monkeypatch, tmp_path, answer):
    (tmp_path / "answer").write_bytes(answer)
    _fake(monkeypatch, tmp_path, f"cat {tmp_path}/answer")
    with pytest.raises(ConfigError, match="was not read: modbus-gateway has been changed since its start; restart it"):
        read_config(Path("/etc/gateway.toml"))


def test_what_a_library_prints_is_no_part_of_the_answer(monkeypatch, tmp_path):
    (tmp_path / "answer").write_bytes(b"hello\n" + ANSWER + packed(NOTHING))
    _fake(monkeypatch, tmp_path, f"cat {tmp_path}/answer")
    assert read_config(Path("/etc/gateway.toml")) == NOTHING


def test_a_process_that_cannot_be_started_is_a_sentence(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with pytest.raises(ConfigError, match="no process can be started for it: No such file or directory"):
        ConfigProcess(Path("gateway.toml"), 1.0)


def test_it_ends_with_the_gateway_that_it_reads_for(tmp_path):
    slow = "import time, gateway.readconfig.reader as reader; reader.read_here = lambda *_, **__: time.sleep(150)"
    program = (
        "import sys, time\n"
        "from pathlib import Path\n"
        "from gateway.readconfig import process as config_process\n"
        f"config_process._PROGRAM = config_process._PROGRAM.replace('main()', '{slow}; main()')\n"
        "print(config_process.ConfigProcess(Path(sys.argv[1]), 150.0)._process.pid, flush=True)\n"
        "time.sleep(60)\n"
    )
    file = tmp_path / "gateway.toml"
    with subprocess.Popen([sys.executable, "-c", program, file], stdout=subprocess.PIPE, text=True) as gateway:
        reader = os.pidfd_open(int(gateway.stdout.readline()))
        gateway.kill()
    try:
        assert select.select([reader], [], [], 120.0)[0]
    finally:
        os.close(reader)
