"""Which gateway a command speaks to: the one that is named, or none, whichever others are there."""

import json
from argparse import Namespace
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from random import Random
from selectors import EVENT_READ, DefaultSelector
from socket import AF_UNIX, socket
from threading import Thread

import pytest

from gateway.cli.kit import daemon
from gateway.cli.kit.daemon import CONTROL_VARIABLE, Conversation, which_gateway
from gateway.cli.main import PROBLEM_FOUND, main
from gateway.cli.verbs import doctor
from gateway.control import path as control_path_module
from gateway.control.path import control_path
from gateway.errors import DaemonError

COMMANDS = (
    *("status", "status --fleet", "reload", "read 17 holding 0", "write 17 holding 0 1234", "scan hall", "trace"),
    *("trace --why 17", "calibrate 17", "bench hall", "doctor"),
)


REFUSAL = {"ok": False, "error": "no"}


class Gateways:
    """What listens at control sockets and answers each request so; `heard` are the sockets that got one."""

    def __init__(self, answer: Mapping[str, object] = REFUSAL) -> None:
        self._answer_line = json.dumps(answer).encode() + b"\n"
        self.heard: list[Path] = []
        self._selector = DefaultSelector()
        self._parts = ExitStack()

    def at(self, path: Path, state: str) -> None:
        """Put a gateway at `path`: one that is `alive`, or the socket of one that is `dead`, or none (`absent`)."""
        if state == "absent":
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        door = self._parts.enter_context(socket(AF_UNIX))
        door.bind(str(path))
        if state == "alive":
            door.listen()
            self._selector.register(door, EVENT_READ, path)

    @contextmanager
    def answering(self) -> Iterator[None]:
        """In this context those that are alive answer."""
        us, them = socket(AF_UNIX), socket(AF_UNIX)
        us.bind("")
        us.listen()
        self._selector.register(us, EVENT_READ)
        thread = Thread(target=self._answer, name="gateways")
        thread.start()
        try:
            yield
        finally:
            them.connect(us.getsockname())
            thread.join()
            us.close()
            them.close()
            self._parts.close()
            self._selector.close()

    def _answer(self) -> None:
        while True:
            for key, _ in self._selector.select():
                if key.data is None:
                    return
                with key.fileobj.accept()[0] as client:  # type: ignore[union-attr]
                    if client.recv(1000):
                        self.heard.append(key.data)
                        client.sendall(self._answer_line)


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """A machine with no gateway where one usually is."""
    for name in ("RUNTIME_DIRECTORY", "XDG_RUNTIME_DIR", CONTROL_VARIABLE):
        monkeypatch.delenv(name, raising=False)
    for module in (daemon, control_path_module):
        monkeypatch.setattr(module, "SYSTEM_SOCKET", tmp_path / "system" / "control.sock")
    for module in (daemon, doctor):
        monkeypatch.setattr(module, "DEFAULT_CONFIG", str(tmp_path / "etc" / "gateway.toml"))
    return monkeypatch


@pytest.mark.parametrize("seed", range(100))
def test_a_command_reaches_the_gateway_that_is_meant_or_none(
    seed: int, tmp_path: Path, machine: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    chance, gateways = Random(seed), Gateways()
    is_root = chance.random() < 0.5
    machine.setattr(daemon, "control_path", partial(control_path, is_root=is_root))
    machine.setenv("XDG_RUNTIME_DIR", str(tmp_path / "xdg"))
    machine.setenv("COLUMNS", "1000")
    places = {
        "system": tmp_path / "system" / "control.sock",
        "user": tmp_path / "xdg" / "modbus-gateway" / "control.sock",
        "variable": tmp_path / "variable.sock",
        "config": tmp_path / "plant" / "gw.sock",
        "control": tmp_path / "control.sock",
    }
    states = {place: chance.choice(("alive", "dead", "absent")) for place in places}
    for place, path in places.items():
        gateways.at(path, states[place])
    words, meant = chance.choice(COMMANDS).split(), "system" if is_root else "user"
    if chance.random() < 0.5:
        machine.setenv(CONTROL_VARIABLE, str(places["variable"]))
        meant = "variable"
    if chance.random() < 0.5:
        config = tmp_path / "plant" / "gateway.toml"
        config.parent.mkdir(exist_ok=True)
        config.write_text(f'[control]\nsocket = "{chance.choice((places["config"], "gw.sock"))}"\n')
        words += ["--config", str(config)]
        meant = "config"
    if chance.random() < 0.3:
        words += ["--control", str(places["control"])]
        meant = "control"
    with gateways.answering():
        assert main(words) == PROBLEM_FOUND
    said = capsys.readouterr()
    is_alive = states[meant] == "alive"
    assert gateways.heard == ([places[meant]] if is_alive else []), words
    assert f"no running gateway found ({places[meant]}: " in said.err + said.out or is_alive
    assert (f"through {places[meant]}\n" in said.err) == (is_alive and words[0] == "reload")


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("", "control.sock"),
        ("[[line]\n", "control.sock"),
        ('[control]\nsocket = "gw.sock"\n', "gw.sock"),
        ('\ufeff[control]\r\nsocket = "/run/gw.sock"\r\n', "/run/gw.sock"),
        ("[control]\nsocket = 3\n", "control.sock"),
    ],
)
def test_the_socket_of_a_config_without_one_or_with_a_relative_one_is_beside_it(
    text: str, meant: str, tmp_path: Path, machine: pytest.MonkeyPatch
) -> None:
    machine.setattr(daemon, "control_path", partial(control_path, is_root=False))
    file = tmp_path / "gateway.toml"
    file.write_text(text, newline="")
    machine.chdir("/")
    assert which_gateway(Namespace(control=None, config=str(file))).socket == tmp_path / meant


@pytest.mark.parametrize("text", [b"[control\n", b"\xff", b"control = " + b"[" * 5000])
def test_a_config_that_cannot_be_read_names_no_gateway(
    text: bytes, tmp_path: Path, machine: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "gateway.toml"
    file.write_bytes(text)
    gateways = Gateways()
    gateways.at(tmp_path / "system" / "control.sock", "alive")
    with gateways.answering(), pytest.raises(DaemonError, match=f"^{file}: .+; --control PATH says where"):
        Conversation(which_gateway(Namespace(control=None, config=str(file))))
    assert gateways.heard == []


@pytest.mark.parametrize(
    ("answer", "is_left"),
    [
        ({"ok": True, "config": "/etc/modbus-gateway/gateway.toml"}, True),
        ({"ok": True, "config": "plant/gateway.toml"}, False),
        ({"ok": False, "error": "there is no such verb"}, False),
    ],
)
def test_a_config_without_a_socket_means_no_gateway_that_runs_with_another_config(
    answer: dict[str, object], is_left: bool, tmp_path: Path, machine: pytest.MonkeyPatch
) -> None:
    """Perhaps that one is the usual one, and the one that is meant does not run."""
    machine.setattr(daemon, "control_path", partial(control_path, is_root=True))
    machine.chdir(tmp_path)
    (tmp_path / "plant").mkdir()
    (tmp_path / "plant" / "gateway.toml").touch()
    gateways = Gateways(answer)
    gateways.at(tmp_path / "system" / "control.sock", "alive")
    meant = which_gateway(Namespace(control=None, config="plant/gateway.toml"))
    with gateways.answering():
        if is_left:
            with pytest.raises(DaemonError, match=r"runs with /etc/modbus-gateway/gateway\.toml, not with plant/"):
                Conversation(meant)
        else:
            with Conversation(meant):
                pass


def test_a_config_that_is_not_there_names_no_gateway(tmp_path: Path) -> None:
    with pytest.raises(DaemonError, match=r"none\.toml: there is no such file; --control PATH says where"):
        which_gateway(Namespace(control=None, config=str(tmp_path / "none.toml")))
