"""`status -w` in a terminal of 80 columns and 24 rows, beside a gateway that stops and comes again."""

import time
from pathlib import Path

from kit.process import PATIENCE, GatewayProcess
from kit.terminal import Terminal

CONFIG = """
[control]
socket = "control.sock"
[[listen]]
bind = "tcp://127.0.0.1:0"
[[line]]
name = "hall-a"
port = "{folder}/usb-FTDI_FT232R_USB_UART_A50285BI-if00-port0-that-is-not-there"
devices = [{{ unit = 1, name = "silo" }}]
[[line]]
name = "hall-b"
port = "{folder}/none"
devices = [{{ unit = 2, name = "press" }}]
"""


def test_status_is_watched_while_the_gateway_stops_and_starts(tmp_path: Path) -> None:
    config = CONFIG.format(folder=tmp_path)
    words = ["-m", "gateway", "status", "-w", "--control", str(tmp_path / "control.sock")]
    with GatewayProcess(tmp_path, config), Terminal(words) as terminal:
        seen = terminal.wait_for("q end")
        assert seen.startswith("What is wrong\n  hall-a: down:")
        wrong, _, tables = seen.partition("\n\n")
        assert "that-is-not-there" in "".join(wrong.split())
        assert "is the adapter plugged in?" in " ".join(wrong.split())
        assert "  hall-b: down:" in wrong
        assert "Lines (busy" in tables
        assert terminal.screen.colours("hall-a: down") == {"31", ""}
        terminal.press("2")
        assert "silo" not in terminal.wait_for("only hall-b").partition("\n\n")[2]
        assert "hall-a: down" in terminal.screen.text
        terminal.press("\x1b")
    with Terminal(words) as terminal:
        assert terminal.wait_for_end() == 1
        assert "no running gateway found" in terminal.screen.text


def test_a_gateway_that_has_gone_is_told(tmp_path: Path) -> None:
    config = CONFIG.format(folder=tmp_path)
    words = ["-m", "gateway", "status", "-w", "--control", str(tmp_path / "control.sock")]
    with GatewayProcess(tmp_path, config):
        terminal = Terminal(words)
        terminal.wait_for("q end")
    with terminal:
        assert "hall-a: down" in terminal.wait_for(" s old")
        with GatewayProcess(tmp_path, config):
            end = time.monotonic() + PATIENCE
            while " s old" in terminal.screen.text and time.monotonic() < end:
                terminal.wait_for("hall-a: down")
            assert " s old" not in terminal.screen.text
            terminal.press("q")
            assert terminal.wait_for_end() == 0
            assert terminal.is_as_before
