"""`ask` as a process: every operation that reads, of a gateway with one line."""

import json
from pathlib import Path

from kit.process import GatewayProcess, command, simulated

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name = "hall"
port = "{port}"
devices = [{{ unit = 1, as = 41, name = "silo-1", profile = "weigher", timeout = "3 s" }}]

[control]
socket = "{control}"
"""


def test_a_gateway_answers_what_it_is_asked(tmp_path: Path) -> None:
    port, at = tmp_path / "hall", ("--control", str(tmp_path / "gw.sock"))

    def asked(*words: str) -> list[object]:
        done = command("ask", *words, *at)
        assert done.returncode == 0, done.stderr
        return [json.loads(text) for text in (done.stdout.splitlines() if words[0] == "scan" else [done.stdout])]

    config = CONFIG.format(port=port, control=tmp_path / "gw.sock")
    with simulated(port, "weigher:1"), GatewayProcess(tmp_path, config):
        [status], [unit] = asked("status"), asked("unit", "unit=silo-1")
        assert (status["lines"][0]["name"], unit["unit"]) == ("hall", 41)
        [answer] = asked("request", "unit=41", "pdu=03 00 00 00 01")
        assert answer["pdu"].startswith("03 02")
        [page] = asked("trace", "since=60", "unit=41")
        assert [fact["kind"] for fact in page["facts"]] == ["exchange"]
        *_, last = asked("scan", "line=hall", "units=7", "limit_s=0.1")
        assert (last["found"], last["asked"]) == ([], 1)
        assert asked("which") == [{"config": str(tmp_path / "gateway.toml")}]
        refused = command("ask", "unit", "unit=9", *at)
        assert (refused.returncode, refused.stdout) == (1, "")
        assert "the gateway says: " in refused.stderr
