"""`trace` against a real gateway: rows, stories, and capture files that tshark decodes without any setting."""

import json
import re
import select
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from gateway.modbus import mbap
from kit.process import COMMAND, PATIENCE, GatewayProcess, command, simulated
from kit.pty import VirtualPort

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name = "hall"
port = "{hall}"
baud = 9600
timeout = "300 ms"
devices = [{{ unit = 6, as = 46, name = "press", timeout = "20 s" }}, {{ unit = 9, as = 49, name = "away" }}]

[[line]]
name = "motion"
port = "{motion}"
mode = "ascii"
devices = [{{ unit = 2, as = 52, name = "axis", timeout = "20 s" }}]

[[line]]
name = "spoiled"
port = "{spoiled}"
timeout = "3 s"
devices = [{{ unit = 1, as = 61, name = "noisy" }}]

[control]
socket = "{control}"
"""


@contextmanager
def gateway_with_lines(folder: Path) -> Iterator[GatewayProcess]:
    hall, motion, control = folder / "hall", folder / "motion", folder / "control.sock"
    with simulated(hall, "v80:6"), simulated(motion, "mint:2"), VirtualPort(folder / "spoiled") as spoiled:
        config = CONFIG.format(hall=hall, motion=motion, control=control, spoiled=spoiled.path)
        with GatewayProcess(folder, config) as running:
            running.control = str(control)
            running.spoiled = spoiled
            yield running


@pytest.fixture
def gateway(tmp_path: Path) -> Iterator[GatewayProcess]:
    with gateway_with_lines(tmp_path) as running:
        yield running


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[GatewayProcess]:
    """One that was asked by `ask_all`, for tests that only look at what it keeps."""
    with gateway_with_lines(tmp_path_factory.mktemp("asked")) as running:
        ask_all(running)
        yield running


def ask(gateway: GatewayProcess, unit: int, pdu: str) -> str:
    with socket.create_connection(("127.0.0.1", gateway.port), PATIENCE) as client:
        client.sendall(mbap.encode(7, unit, bytes.fromhex(pdu)))
        return client.recv(300)[7:].hex(" ").upper()


def speak(port: VirtualPort, data: bytes) -> None:
    """Wait for a request and answer it with these bytes."""
    select.select([port.far_end], [], [], PATIENCE)
    port.write(data)


def ask_all(gateway: GatewayProcess) -> None:
    """Good answers on an RTU and an ASCII line, silence, and one with a wrong check sum."""
    assert ask(gateway, 46, "03 00 6B 00 03") == "03 06 00 63 00 63 00 63"
    assert ask(gateway, 52, "03 00 01 00 01")[:5] == "03 02"
    assert ask(gateway, 49, "03 00 00 00 01") == "83 0B"
    speaking = threading.Thread(target=speak, args=(gateway.spoiled, bytes.fromhex("01 03 02 01 10 B8 19")))
    speaking.start()
    assert ask(gateway, 61, "03 00 00 00 01") == "83 0B"
    speaking.join()


def trace(gateway: GatewayProcess, *words: str, code: int = 0) -> str:
    done = command("trace", *words, "--control", gateway.control)
    assert done.returncode == code, done.stderr
    return done.stdout


def test_what_has_passed_is_shown_in_words(asked: GatewayProcess) -> None:
    rows = [row.split("  ", 1)[1].strip() for row in trace(asked, "--since", "5min").splitlines()]
    assert any(
        re.fullmatch(r"hall +> +6 +read holding 107-109 \(40108-40110\) +\[127.0.0.1:\d+ as 46(, .*)?\]", row)
        for row in rows
    )
    assert any(re.fullmatch(r"hall +< +6 +99 99 99 +\[[\d.]+ of \d+ ms\]", row) for row in rows)
    assert any(re.search(r"hall +- +9 +timeout .*exception 0B", row) for row in rows)
    assert any(re.search(r"spoiled +< +\? +no valid response: 01 03 02 01 10 B8 19", row) for row in rows)
    assert all(" 6  " in row for row in trace(asked, "hall", "--unit", "press", "--since", "5min").splitlines())
    facts = [json.loads(line) for line in trace(asked, "--since", "5min", "--json", "-n", "1").splitlines()]
    assert [(fact["line"], fact["result"]) for fact in facts] == [("spoiled", "bad_frame")]


def test_stories_of_a_real_gateway(gateway: GatewayProcess) -> None:
    ask_all(gateway)
    ask(gateway, 99, "03 00 00 00 01")
    assert "No response came within 3" in trace(gateway, "--why", "away")
    assert "no check sum fits" in " ".join(trace(gateway, "--why", "61").split())
    told = " ".join(trace(gateway, "--why", "127.0.0.1").split())
    assert told.count("asked unit") == 3
    assert told.endswith("exception 0A, gateway path unavailable.")
    assert trace(gateway, "--why", "press", code=1) == ""


def test_raw_shows_the_frames_of_the_line(gateway: GatewayProcess) -> None:
    at = ("--raw", "--control", gateway.control)
    shown = command("read", "press", "holding", "107-109", *at).stdout.splitlines()
    assert shown[:2] == ["> 06 03 00 6B 00 03 75 A0", "< 06 03 06 00 63 00 63 00 63 73 7A"]
    shown = command("read", "axis", "holding", "1", *at).stdout.splitlines()
    assert (shown[0], shown[1][:7]) == ("> :020300010001F9", "< :0203")


def test_a_live_trace_shows_what_passes_and_ends_by_ctrl_c(gateway: GatewayProcess) -> None:
    words = [*COMMAND, "trace", "hall", "--control", gateway.control]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as following:
        assert "port open" in following.stdout.readline()
        ask(gateway, 46, "03 00 6B 00 03")
        assert "read holding 107-109" in following.stdout.readline()
        assert "99 99 99" in following.stdout.readline()
        following.send_signal(signal.SIGINT)
        _, complaint = following.communicate(timeout=PATIENCE)
    assert (following.returncode, complaint) == (130, "")


def test_a_reader_that_does_not_read_holds_up_nobody(gateway: GatewayProcess) -> None:
    with socket.socket(socket.AF_UNIX) as idle:
        idle.connect(gateway.control)
        idle.sendall(b'{"verb": "trace", "since": 3600}\n' * 2000)
        began = time.monotonic()
        ask_all(gateway)
        assert time.monotonic() - began < PATIENCE / 2
    assert "99 99 99" in trace(gateway, "--since", "5min")


def decoded(file: Path, *fields: str) -> list[list[str]]:
    words = ["tshark", "-n", "-r", str(file), "-T", "fields", *(word for field in fields for word in ("-e", field))]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return [line.split("\t") for line in done.stdout.splitlines()]


@pytest.mark.needs("tshark")
def test_tshark_decodes_a_capture_without_settings(asked: GatewayProcess, tmp_path: Path) -> None:
    file = tmp_path / "hall.pcapng"
    done = command("trace", "--since", "5min", "--pcapng", str(file), "--control", asked.control)
    assert (done.returncode, done.stdout) == (0, "")
    assert "7 frames written" in done.stderr
    fields = (
        "frame.interface_name",
        "frame.p2p_dir",
        "modbus.func_code",
        "modbus.reference_num",
        "modbus.regval_uint16",
    )
    frames = sorted(decoded(file, *fields, "mbrtu.unit_id", "frame.comment"))
    asked = [frame[:4] + frame[5:6] for frame in frames if frame[1] == "0"]
    assert sorted(asked) == [
        ["hall", "0", "3", "0", "9"],
        ["hall", "0", "3", "107", "6"],
        ["motion", "0", "3", "1", "2"],
        ["spoiled", "0", "3", "0", "1"],
    ]
    answers = {frame[0]: frame for frame in frames if frame[1] == "1"}
    assert answers["hall"][4] == "99,99,99"
    assert answers["motion"][5] == "2"
    assert re.fullmatch(r"[\d.]+ ms after the request, limit [\d.]+ ms", answers["hall"][6])
    assert answers["spoiled"][6].startswith("wrong check sum; ")
    marked = decoded(file, "frame.interface_name", "frame.packet_flags_crc_error")
    assert [line[0] for line in marked if line[1] in {"1", "True"}] == ["spoiled"]


@pytest.mark.needs("tshark")
def test_check_sums_are_right_where_they_were_also_for_ascii(asked: GatewayProcess, tmp_path: Path) -> None:
    file = tmp_path / "all.pcapng"
    command("trace", "--since", "5min", "--pcapng", str(file), "--control", asked.control)
    words = ["tshark", "-n", "-r", str(file), "-o", "mbrtu.crc_verification:TRUE", "-T", "fields"]
    words += ["-e", "frame.interface_name", "-e", "mbrtu.crc16.status"]
    done = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    found = [line.split("\t") for line in done.splitlines()]
    assert {tuple(line) for line in found if line[1] != "1"} == {("spoiled", "0")}
    assert {line[0] for line in found} == {"hall", "motion", "spoiled"}


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--since", "5"], '--since: a duration needs a unit: write "5 ms" or "5 s"'),
        (["--why", "46", "--pcapng", "x"], "leave one of them out"),
        (["--why", "46", "--since", "5min"], "modbus-gateway trace --why 46"),
        (["--json", "--pcapng", "x"], "leave one of them out"),
        (["-n", "none"], "write a number such as 10"),
        (["--why", "46", "-n", "1000"], "-n 50 at most"),
    ],
)
def test_what_cannot_be_meant_is_answered_with_what_to_type(words: list[str], complaint: str) -> None:
    done = command("trace", *words)
    assert (done.returncode, done.stdout) == (2, "")
    assert complaint in done.stderr


def test_a_line_or_a_unit_that_is_not_there_is_told(asked: GatewayProcess) -> None:
    for words, complaint in (
        (["hal"], 'there is no line "hal"; there are hall, motion, spoiled'),
        (["--unit", "pres"], 'did you mean "press"?'),
        (["--pcapng", "/nowhere/x"], "/nowhere/x cannot be written: No such file or directory"),
    ):
        done = command("trace", *words, "--since", "1min", "--control", asked.control)
        assert (done.returncode, done.stdout) == (1, "")
        assert complaint in done.stderr


def test_with_the_ring_off_it_is_told_what_to_set(tmp_path: Path) -> None:
    control = tmp_path / "control.sock"
    config = f'[[image]]\nunit = 1\nholding = 1\n[trace]\nring = "0"\n[control]\nsocket = "{control}"\n'
    with GatewayProcess(tmp_path, f'[[listen]]\nbind = "tcp://127.0.0.1:0"\n{config}'):
        for words in (["--since", "1min"], ["--why", "1"], []):
            done = command("trace", *words, "--control", str(control))
            assert (done.returncode, done.stdout) == (1, "")
            assert 'nothing is kept: [trace] ring is "0"; set it to "4 MiB"' in done.stderr
