"""A config in several files, of a gateway that runs: one file more, a broken one, and what is told and kept of them."""

import socket
import tarfile
import urllib.request
from pathlib import Path

from kit.process import PATIENCE, GatewayProcess, command

MAIN = """
include = ["conf.d/*.toml"]

[[listen]]
bind = "tcp://127.0.0.1:0"

[[image]]
unit = 200
holding = 10
"""
MORE = "[[image]] # secret-comment\nunit = 201\nholding = 10\n"


def asked(client: socket.socket, unit: int) -> int:
    """Read a register; return the function of the response, or the exception."""
    client.sendall(bytes.fromhex(f"0001 0000 0006 {unit:02x} 03 0000 0001"))
    response = client.recv(260)
    return response[8] if response[7] & 0x80 else response[7]


def test_files_are_included_at_the_start_and_by_a_reload_which_takes_all_or_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "conf.d"
    folder.mkdir()
    (folder / "10-doors.toml").write_text('[web]\nbind = "http://127.0.0.1:0"\n\n[control]\nsocket = "../c.sock"\n')
    with GatewayProcess(tmp_path, MAIN) as gateway:
        which = ("--config", str(gateway.config))  # its socket is in the other file
        (page,) = (event["address"] for event in gateway.log if event["event"] == "web_up")
        with socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE) as client:
            assert (asked(client, 200), asked(client, 201)) == (3, 0x0A)

            (folder / "20-more.toml").write_text(MORE)
            assert command("check", str(gateway.config)).returncode == 0
            assert command("reload", *which).stdout == "new: image image-201\n"
            assert (asked(client, 200), asked(client, 201)) == (3, 3)

            (folder / "20-more.toml").write_text(MORE.replace("10", "no"))
            gateway.config.write_text(gateway.config.read_text().replace("200", "202"))
            rejected = command("reload", *which)
            assert rejected.returncode == 1
            assert f"{folder}/20-more.toml:3:11: error: " in rejected.stdout
            assert (asked(client, 200), asked(client, 201), asked(client, 202)) == (3, 3, 0x0A)

        with urllib.request.urlopen(f"{page}/api/v1/config", timeout=PATIENCE) as answer:
            told = answer.read().decode()
        assert r"#:include conf.d/20-more.toml\n[[image]]\nunit = 201" in told
        assert "secret-comment" not in told

        *_, last = sorted((tmp_path / "configs").iterdir())
        assert (last / "include" / "conf.d%2F20-more.toml").read_text() == MORE
        assert "image" not in (last / "include" / "conf.d%2F10-doors.toml").read_text()
        assert (last / "gateway.toml").read_text().startswith(MAIN)

        bundle = tmp_path / "bundle.tar.gz"
        assert command("support", str(bundle), *which).returncode == 0
        with tarfile.open(bundle) as packed:
            names = {name.partition("/")[2] for name in packed.getnames()}
        assert "config/include/conf.d%2F10-doors.toml" in names
        assert gateway.stop() == 0


def test_a_gateway_does_not_start_with_a_broken_file_and_says_which(tmp_path: Path) -> None:
    (tmp_path / "conf.d").mkdir()
    (tmp_path / "conf.d" / "b.toml").write_text("[[image]]\nunit = 300\n")
    (tmp_path / "gateway.toml").write_text(MAIN)
    ended = command("run", str(tmp_path / "gateway.toml"))
    assert ended.returncode == 1
    assert f"{tmp_path}/conf.d/b.toml:2:8: error: image[0].unit: " in ended.stderr
