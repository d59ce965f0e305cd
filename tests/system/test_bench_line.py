"""`bench` and `status` as processes, with a simulated line. Its figures are not compared: machines are busy."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from kit.process import GatewayProcess, command, simulated

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name = "hall"
port = "{port}"
mode = "ascii"
max_wait = "60 s"
devices = [{{ unit = 1, as = 51, name = "axis-1", profile = "mint", timeout = "20 s" }}]

[control]
socket = "{control}"
"""


@pytest.fixture
def control(tmp_path: Path) -> Iterator[str]:
    """The control socket of a gateway with a simulated line."""
    port, path = tmp_path / "hall", str(tmp_path / "control.sock")
    with simulated(port, "mint:1"), GatewayProcess(tmp_path, CONFIG.format(port=port, control=path)):
        yield path


def test_bench_shows_what_a_line_can_carry_and_status_who_uses_it(control: str) -> None:
    done = command("bench", "hall", "--for", "4s", "--items", "5", "--json", "--control", control)
    result = json.loads(done.stdout)
    assert done.returncode == 0, done.stderr
    (read,) = result["reads"]
    assert (read["unit"], read["area"], read["address"], read["items"]) == (51, "holding", 1, 5)
    assert result["answered"] > 0
    assert (result["exceptions"], result["failed"], result["others"]) == (0, 0, 0)
    (line,) = json.loads(command("status", "--json", "--control", control).stdout)["lines"]
    assert [(user["client"], user["device"], user["function"]) for user in line["users"]] == [("control", "axis-1", 3)]
    shown = command("bench", "hall", "--unit", "axis-1", "--for", "3s", "--control", control)
    assert "by arithmetic" in shown.stdout
    assert "measured is " in shown.stdout


def test_a_line_that_does_not_exist_is_said(control: str) -> None:
    done = command("bench", "hal", "--control", control)
    assert (done.returncode, done.stdout) == (1, "")
    assert 'there is no line "hal"; did you mean "hall"?' in done.stderr
