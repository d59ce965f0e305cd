"""The service's units in a system that is booted for it."""

import os
import socket
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from gateway.modbus.rtu import encode
from gateway.ports.tcp import CONNECTING_DEADLINE
from kit.booted import SERVICE, SOCKET, BootedSystem, CannotBootError, booted, until, why_not
from kit.device import SimulatedDevice, SimulatedLine
from kit.pki import OPERATOR, VIEWER, client_context, pki
from kit.pty import VirtualPort
from kit.serial_line import SerialDevices

pytestmark = pytest.mark.skipif(bool(why_not()), reason=f"{why_not()}: the service's units were not booted")

CONFIG = """
[[listen]]
bind = "tcp://[::]:502"

[[line]]
name = "hall-a"
port = "/dev/hall-a"
devices = [{ unit = 1, timeout = "20 s" }, { unit = 46, timeout = "100 ms" }]

[[image]]
unit = 200
holding = 10
persist = "always"
"""
SECURED = """
[[listen]]
name = "remote"
bind = "tls://[::]:802"
certificate = "/etc/modbus-gateway/tls/server.crt"
key = { credential = "server.key" }
clients_ca = "/etc/modbus-gateway/tls/ca.crt"
crl = "/etc/modbus-gateway/tls/ca.crl"

[[access]]
role = "operator"
allow = ["read", "write"]

[[access]]
allow = ["read"]
listen = ["remote"]

[[access]]
allow = ["read"]
"""
#: Its registers are 1 for what is as docs/images.md says.
RIGHTS_OF_A_UNIT = """
import mmap, os, socket
from pathlib import Path
from gateway import CustomUnit

def can(call, *words):
    try:
        call(*words)
    except OSError:
        return False
    return True

class Rights(CustomUnit):
    async def read(self, area, address, count):
        state = Path(os.environ["STATE_DIRECTORY"])
        return [
            can((state / "own").write_text, "x"),
            not can(Path("/etc/modbus-gateway/own").write_text, "x"),
            not can(os.listdir, "/home") or not os.listdir("/home"),
            not can(mmap.mmap, -1, 4096, mmap.MAP_PRIVATE, mmap.PROT_WRITE | mmap.PROT_EXEC),
            not can(socket.socket, socket.AF_NETLINK),
        ]
"""
READ = bytes.fromhex("0001 0000 0006 01 03 0000 0001")
RIGHT = bytes.fromhex("0001 0000 0005 01 03 02 1234")
FILE = "/etc/modbus-gateway/gateway.toml"
DIALOUT = 20


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BootedSystem]:
    try:
        with booted(tmp_path_factory.mktemp("system")) as system:
            yield system
    except CannotBootError as why:
        pytest.skip(f"systemd-nspawn cannot boot a system here, so the service's units were not booted: {why}")


@pytest.fixture
def device() -> SimulatedDevice:
    return holding_1234()


def holding_1234() -> SimulatedDevice:
    device = SimulatedDevice(1)
    device.holding[0] = 0x1234
    return device


@pytest.fixture
def system(machine: BootedSystem, device: SimulatedDevice, tmp_path: Path) -> Iterator[BootedSystem]:
    """A system with a config, a line with its device, and an empty log; nothing is started yet."""
    machine.forget_log()
    machine.write(FILE, CONFIG)
    with line_of(machine, device, tmp_path):
        yield machine
        stop(machine)


@contextmanager
def line_of(machine: BootedSystem, device: SimulatedDevice, folder: Path) -> Iterator[None]:
    with VirtualPort(folder / "hall-a") as port, SerialDevices({port: SimulatedLine("rtu", device)}):
        give_to_dialout(Path(port.device))
        link = machine.root / "dev/hall-a"
        link.symlink_to(port.device.replace("/dev/pts", "/dev/hostpts"))
        yield
        link.unlink()


def stop(machine: BootedSystem) -> None:
    """Leave nothing behind."""
    machine.done("systemctl", "stop", SOCKET, SERVICE)
    machine.done("sh", "-c", "systemctl reset-failed; rm -rf /var/lib/private/modbus-gateway")
    machine.end_overrides()


def give_to_dialout(node: Path) -> None:
    os.chown(node, 0, DIALOUT)
    node.chmod(0o660)


def start(system: BootedSystem) -> None:
    system.done("systemctl", "start", SERVICE)


def asked(client: socket.socket, request: bytes = READ) -> bytes:
    client.sendall(request)
    return client.recv(260)


class TestOneStart:
    """These leave it running with the same config, so it is started once for all of them; the last one stops it."""

    @pytest.fixture(scope="class")
    @classmethod
    def device(cls) -> SimulatedDevice:
        return holding_1234()

    @pytest.fixture(scope="class")
    @classmethod
    def running(
        cls, machine: BootedSystem, device: SimulatedDevice, tmp_path_factory: pytest.TempPathFactory
    ) -> Iterator[BootedSystem]:
        machine.write(FILE, CONFIG)
        with line_of(machine, device, tmp_path_factory.mktemp("line")):
            yield machine
            stop(machine)

    @pytest.fixture
    def system(self, running: BootedSystem) -> BootedSystem:
        running.forget_log()
        return running

    def test_active_means_that_every_address_is_bound_and_every_line_was_tried(self, system: BootedSystem) -> None:
        start(system)
        assert system.show("ActiveState") == "active"
        assert system.show("StatusText") == "1 of 1 lines up, 0 clients"
        for host in ("127.0.0.1", "::1"):
            with system.connect(host) as client:
                assert asked(client) == RIGHT

    def test_root_can_ask_it_how_it_is(self, system: BootedSystem) -> None:
        start(system)
        assert "hall-a" in system.done("modbus-gateway", "status")

    def test_events_are_entries_of_the_journal_with_fields(self, system: BootedSystem) -> None:
        start(system)
        with system.connect() as client:
            assert asked(client, bytes.fromhex("0001 0000 0006 2E 03 0000 0001"))[-2:] == b"\x83\x0b"
        until(lambda: system.log("MODBUS_UNIT=46"), system.status)
        entry = system.log("MODBUS_UNIT=46")[0]
        assert (entry["MODBUS_EVENT"], entry["MODBUS_LINE"], entry["PRIORITY"]) == ("request_timeout", "hall-a", "4")
        assert (entry["SYSLOG_IDENTIFIER"], entry["_SYSTEMD_UNIT"]) == ("modbus-gateway", SERVICE)
        assert entry["MESSAGE"].startswith("request_timeout line=hall-a unit=46")

    def test_the_journal_finds_what_is_about_one_machine(self, system: BootedSystem) -> None:
        start(system)
        with system.connect() as client:
            assert asked(client, bytes.fromhex("0001 0000 0006 63 03 0000 0001"))[-2:] == b"\x83\x0a"
        until(lambda: system.log("MODBUS_CLIENT_ADDRESS=127.0.0.1"), system.status)
        assert system.log("MODBUS_CLIENT_ADDRESS=127.0.0.1")[0]["MODBUS_EVENT"] == "request_refused"

    def test_reload_applies_a_good_file_and_fails_with_a_bad_one(self, system: BootedSystem) -> None:
        start(system)
        process = system.show("MainPID")
        with system.connect() as client:
            assert asked(client) == RIGHT
            system.write(FILE, CONFIG + "[[image]]\nunit = 201\nholding = 1\n")
            system.done("systemctl", "reload", SERVICE)
            assert asked(client, bytes.fromhex("0001 0000 0006 C9 03 0000 0001"))[-2:] == b"\0\0"
            system.write(FILE, CONFIG + "[[image]]\n")
            assert system.run("systemctl", "reload", SERVICE).returncode != 0
            reason = system.wait_for("config_rejected")["MODBUS_REASON"]
            assert reason == f"{FILE}:14:1: error: image[1].unit: unit is missing"
            system.write(FILE, CONFIG.replace(":502", ":5020"))
            assert "systemd has opened tcp://[::]:502, which no" in system.run("modbus-gateway", "reload").stdout
            assert asked(client) == RIGHT
            system.write(FILE, CONFIG)
            system.done("systemctl", "kill", "--signal=HUP", SERVICE)
            until(lambda: len(system.log("MODBUS_EVENT=config_applied")) == 2, system.status)
            assert asked(client) == RIGHT
        assert (system.show("ActiveState"), system.show("MainPID")) == ("active", process)

    def test_a_profile_that_root_has_added_is_one_that_the_service_can_read(self, system: BootedSystem) -> None:
        start(system)
        system.write("/root/meter.toml", "[profile.meter]\nfunctions = [4]\n")
        added = system.done("sh", "-c", "umask 077; modbus-gateway profile add /root/meter.toml")
        assert "meter is in /etc/modbus-gateway/profiles/meter.toml" in added
        system.write(FILE, CONFIG + '[[image]]\nunit = 201\nholding = 1\nprofile = "meter"\n')
        system.done("systemctl", "reload", SERVICE)
        with system.connect() as client:
            assert asked(client, bytes.fromhex("0001 0000 0006 C9 03 0000 0001"))[-2:] == b"\x83\x01"
        system.write(FILE, CONFIG)
        system.done("systemctl", "reload", SERVICE)

    def test_a_unit_made_in_python_is_imported_from_beside_the_config_and_has_the_rights_of_the_service(
        self, system: BootedSystem
    ) -> None:
        start(system)
        system.write("/etc/modbus-gateway/rights.py", RIGHTS_OF_A_UNIT)
        made = '[[image]]\nunit = 201\npython = "rights:Rights"\n'
        system.write(FILE, CONFIG + made)
        system.done("systemctl", "reload", SERVICE)
        with system.connect() as client:
            assert asked(client, bytes.fromhex("0001 0000 0006 C9 03 0000 0005"))[7:].hex() == "030a" + "0001" * 5
        assert not (system.root / "etc/modbus-gateway/__pycache__").exists()
        system.write(FILE, CONFIG)
        system.done("systemctl", "reload", SERVICE)

    @pytest.mark.parametrize("end", [("kill", "--signal=KILL"), ("restart", "--no-block")])
    def test_a_client_that_comes_while_it_restarts_waits_for_its_answer(
        self, system: BootedSystem, end: tuple[str, ...]
    ) -> None:
        start(system)
        process = system.show("MainPID")
        system.done("systemctl", *end, SERVICE)
        until(lambda: system.show("MainPID") != process, system.status)
        with system.connect() as client:
            assert asked(client) == RIGHT

    def test_what_was_written_to_an_image_outlives_kill_in_the_state_directory(self, system: BootedSystem) -> None:
        write, read = (bytes.fromhex(f"0001 0000 0006 C8 {pdu}") for pdu in ("06 0000 0007", "03 0000 0001"))
        start(system)
        with system.connect() as client:
            assert asked(client, write) == write
        restarts = str(int(system.show("NRestarts")) + 1)
        system.done("systemctl", "kill", "--signal=KILL", SERVICE)
        until(lambda: system.show("NRestarts") == restarts, system.status)
        with system.connect() as client:
            assert asked(client, read) == bytes.fromhex("0001 0000 0005 C8 03 02 0007")
        assert (system.root / "var/lib/private/modbus-gateway").stat().st_uid >= 61184  # a dynamic user

    def test_stop_answers_what_is_under_way_and_ends_well(self, system: BootedSystem, device: SimulatedDevice) -> None:
        start(system)
        device.delay = 0.5
        known = len(device.heard)
        with system.connect() as client:
            client.sendall(READ)
            until(lambda: len(device.heard) > known, system.status)
            system.done("systemctl", "stop", SOCKET, SERVICE)
            assert client.recv(260) == RIGHT
            assert client.recv(260) == b""
        assert (system.show("Result"), system.show("ExecMainStatus")) == ("success", "0")


@pytest.mark.search
def test_for_ipv4_clients_only_it_takes_the_same_socket(system: BootedSystem) -> None:
    system.write(FILE, CONFIG.replace("[::]", "0.0.0.0"))
    start(system)
    assert system.wait_for("ready")["MODBUS_LISTENERS"] == "tcp://0.0.0.0:502"
    with system.connect("::1") as other, system.connect() as client:
        assert other.recv(260) == b""
        assert asked(client) == RIGHT
    assert system.wait_for("client_rejected")["MODBUS_CLIENT_ADDRESS"] == "::1"
    assert (system.show("ActiveState"), system.show("NRestarts")) == ("active", "0")


def test_it_is_not_active_while_a_line_is_still_being_tried(system: BootedSystem) -> None:
    with system.open_socket() as full, system.open_socket() as first:
        full.bind(("127.0.0.1", 4001))
        full.listen(0)
        first.connect(("127.0.0.1", 4001))
        line = '[[line]]\nname = "roof"\nport = "rtu+tcp://127.0.0.1:4001"\ndevices = [{ unit = 9 }]\n'
        system.write(FILE, CONFIG + line)
        system.done("systemctl", "start", "--no-block", SERVICE)
        system.wait_for("line_lost")
        until(lambda: system.show("ActiveState") == "active", system.status)
        began, ended = (int(system.show(f"{name}TimestampMonotonic")) for name in ("ExecMainStart", "ActiveEnter"))
        assert (ended - began) / 1_000_000 > CONNECTING_DEADLINE
        system.wait_for("ready")
        said = [each.get("MODBUS_EVENT") for each in system.log()]  # on a busy machine any start takes that long
        assert said.index("line_lost") < said.index("ready")
        assert system.show("StatusText").startswith("1 of 2 lines up, 0 clients; roof: ")


@pytest.mark.search
def test_it_is_active_though_more_lines_are_down_than_its_status_can_tell(system: BootedSystem) -> None:
    line = '[[line]]\nport = "/dev/serial/by-id/{0}-{1}"\ndevices = [{{ unit = {1} }}]\n'
    system.write(FILE, CONFIG + "".join(line.format("x" * 150, unit) for unit in range(101, 141)))
    start(system)
    system.done("systemctl", "reload", SERVICE)
    until(lambda: system.show("StatusText").startswith("1 of 41 lines up, 0 clients; xxx"), system.status)
    assert system.show("ActiveState") == "active"


def test_a_client_starts_it_and_stopping_the_socket_ends_both(system: BootedSystem) -> None:
    system.done("systemctl", "start", SOCKET)
    assert system.show("ActiveState") == "inactive"
    with system.connect() as client:
        assert asked(client) == RIGHT
    system.done("systemctl", "stop", SOCKET)
    assert system.show("ActiveState") == "inactive"
    with system.open_socket() as client, pytest.raises(ConnectionRefusedError):
        client.connect(("127.0.0.1", 502))


@pytest.mark.search
def test_the_config_may_move_the_control_socket(system: BootedSystem) -> None:
    system.write(FILE, f'{CONFIG}[control]\nsocket = "/run/modbus-gateway/other.sock"\n')
    start(system)
    system.done("systemctl", "reload", SERVICE)
    assert "hall-a" in system.done("modbus-gateway", "status")
    assert "hall-a" in system.done("modbus-gateway", "status", "--config", FILE)


def test_the_watchdog_restarts_it_when_it_hangs(system: BootedSystem) -> None:
    system.override(SERVICE, "[Service]\nWatchdogSec=3s\n")
    start(system)
    process = system.show("MainPID")
    system.done("systemctl", "kill", "--signal=STOP", SERVICE)
    until(lambda: system.show("MainPID") != process, system.status)
    with system.connect() as client:
        assert asked(client) == RIGHT
    for said in ("Watchdog timeout", "most recent call first"):
        until(lambda said=said: any(said in entry["MESSAGE"] for entry in system.log()), system.status)


def test_the_journal_drops_nothing_of_what_it_is_told(system: BootedSystem) -> None:
    """Though others on this machine are held to so much less."""
    system.write("/run/systemd/journald.conf.d/test.conf", "[Journal]\nRateLimitIntervalSec=30s\nRateLimitBurst=10\n")
    system.done("systemctl", "restart", "systemd-journald.service")
    try:
        start(system)
        with system.connect() as client:
            for number in range(1000):
                write = bytes.fromhex(f"0001 0000 0006 C8 06 0000 {number:04X}")
                assert asked(client, write) == write
        until(lambda: len(system.log("MODBUS_EVENT=write_audit")) == 1000, system.status)
    finally:
        system.done("rm", "/run/systemd/journald.conf.d/test.conf")
        system.done("systemctl", "restart", "systemd-journald.service")


@pytest.mark.search
def test_it_starts_at_an_address_that_is_not_there_yet(system: BootedSystem) -> None:
    system.override(SOCKET, "[Socket]\nListenStream=\nListenStream=10.2.0.1:502\n")
    system.write(FILE, CONFIG.replace("[::]", "10.2.0.1"))
    start(system)
    system.add_address("10.2.0.1")
    with system.connect("10.2.0.1") as client:
        assert asked(client) == RIGHT


def test_a_bad_file_is_tried_again_every_few_seconds(system: BootedSystem) -> None:
    system.write(FILE, "[[line]]\n")
    assert system.run("systemctl", "start", SERVICE).returncode != 0
    until(lambda: len(system.log("MODBUS_EVENT=config_rejected")) >= 2, system.status)
    # A busy journal does not find out the unit of a process that has ended by then: one of a later try has it.
    until(lambda: system.log("MODBUS_EVENT=config_rejected", f"_SYSTEMD_UNIT={SERVICE}"), system.status)
    rejected = system.log("MODBUS_EVENT=config_rejected")
    assert {entry["PRIORITY"] for entry in rejected} == {"3"}
    assert "line[0].port: port is missing" in rejected[0]["MODBUS_REASON"]
    tries = [int(entry["_SOURCE_REALTIME_TIMESTAMP"]) for entry in rejected]  # the journal may take it later
    assert tries[1] - tries[0] > 2_000_000
    system.write(FILE, CONFIG)
    with system.connect() as client:
        assert asked(client) == RIGHT


@pytest.mark.search
@pytest.mark.parametrize(
    ("streams", "problem"),
    [
        ("ListenStream=127.0.0.1:5021", "systemd has opened tcp://127.0.0.1:5021, which no [[listen]] names"),
        ("ListenStream=\nListenStream=0.0.0.0:502", "cannot listen on tcp://[::]:502: tcp://0.0.0.0:502 has this port"),
    ],
)
def test_a_socket_that_fits_no_listener_is_an_error_that_names_it(
    system: BootedSystem, streams: str, problem: str
) -> None:
    system.override(SOCKET, f"[Socket]\n{streams}\n")
    assert system.run("systemctl", "start", SERVICE).returncode != 0
    assert problem in system.wait_for("config_rejected")["MODBUS_REASON"]


@pytest.mark.search
def test_every_address_of_the_socket_unit_has_its_listener(system: BootedSystem) -> None:
    system.override(SOCKET, "[Socket]\nListenStream=\nListenStream=0.0.0.0:502\nListenDatagram=[::]:502\n")
    system.write(FILE, CONFIG.replace("[::]", "0.0.0.0") + '[[listen]]\nname = "udp"\nbind = "udp://0.0.0.0:502"\n')
    start(system)
    with system.connect() as client, system.open_socket(kind=socket.SOCK_DGRAM) as datagrams:
        assert asked(client) == RIGHT
        datagrams.connect(("127.0.0.1", 502))
        assert asked(datagrams) == RIGHT


@pytest.mark.search
def test_two_listeners_share_a_port_once_the_socket_unit_names_both(system: BootedSystem) -> None:
    system.override(SOCKET, "[Socket]\nBindIPv6Only=ipv6-only\nListenStream=0.0.0.0:502\n")
    system.write(FILE, CONFIG + '[[listen]]\nbind = "tcp://0.0.0.0:502"\n')
    start(system)
    for host in ("127.0.0.1", "::1"):
        with system.connect(host) as client:
            assert asked(client) == RIGHT


def secure(system: BootedSystem) -> None:
    """As docs/certificates.md says: certificates, the key as root's secret, port 802."""
    for name in ("server.crt", "server.key", "ca.crt", "ca.crl"):
        system.write(f"/etc/modbus-gateway/tls/{name}", (pki() / name).read_text())
    (system.root / "etc/modbus-gateway/tls/server.key").chmod(0o600)
    system.write(FILE, CONFIG + SECURED)
    system.override(SOCKET, "[Socket]\nListenStream=802\n")


def test_a_key_that_only_root_can_read_is_handed_over_as_a_credential(system: BootedSystem) -> None:
    secure(system)
    system.override(SERVICE, "[Service]\nLoadCredential=server.key:/etc/modbus-gateway/tls/server.key\n")
    start(system)
    for name, answer in ((OPERATOR, "06 0000 0001"), (VIEWER, "86 01")):
        with client_context(name).wrap_socket(system.connect(port=802), server_hostname="localhost") as client:
            client.sendall(bytes.fromhex("0001 0000 0006 C8 06 0000 0001"))
            assert client.recv(260)[7:] == bytes.fromhex(answer)
    system.done("modbus-gateway", "reload")
    limits = Path(f"/proc/{system.leader}/root/proc/{system.show('MainPID')}/limits").read_text()
    assert limits.partition("Max core file size")[2].split()[0] == "0"


def test_a_credential_that_nobody_hands_over_is_named(system: BootedSystem) -> None:
    secure(system)
    system.run("systemctl", "start", "--no-block", SERVICE)
    said = system.wait_for("config_rejected")["MESSAGE"]
    assert "server.key: there is no such credential: LoadCredential= is missing in the unit" in said
    system.write(
        FILE, CONFIG + SECURED.replace('{ credential = "server.key" }', '"/etc/modbus-gateway/tls/server.key"')
    )
    rejected = "MODBUS_EVENT=config_rejected"
    until(
        lambda: any("server.key: permission denied" in each["MESSAGE"] for each in system.log(rejected)), system.status
    )


def test_devices_other_than_serial_ports_are_kept_from_it(system: BootedSystem) -> None:
    """An adapter that is plugged in later has to be allowed too: 188 is ttyUSB, whose driver is not loaded here."""
    reasons = {
        60: "/dev/ttyTEST60 is not allowed for this service: allow it with DeviceAllow= in its unit",
        188: "/dev/ttyTEST188 has no hardware behind it",
    }
    nodes = {major: system.root / f"dev/ttyTEST{major}" for major in reasons}
    lines = [f'[[line]]\nport = "/dev/ttyTEST{major}"\ndevices = [{{ unit = {major} }}]\n' for major in reasons]
    try:
        for major, node in nodes.items():
            os.mknod(node, stat.S_IFCHR, os.makedev(major, 0))
            give_to_dialout(node)
        system.write(FILE, CONFIG + "".join(lines))
        start(system)
        until(lambda: len(system.log("MODBUS_EVENT=line_lost")) >= len(reasons), system.status)
        assert {entry["MODBUS_REASON"] for entry in system.log("MODBUS_EVENT=line_lost")} == set(reasons.values())
    finally:
        for node in nodes.values():
            node.unlink()


def test_it_can_use_an_image_that_root_has_made_by_hand(system: BootedSystem) -> None:
    system.write(FILE, CONFIG.replace("always", "never"))
    start(system)
    system.done("systemctl", "stop", SOCKET, SERVICE)
    system.write(FILE, CONFIG)
    system.done("systemd-run", "--unit=by-hand", "--property=Type=notify", "modbus-gateway", "run")
    system.done("systemctl", "stop", "by-hand.service")
    start(system)


ON_A_VIRTUAL_PORT = """
import os, sys
port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
os.write(port, bytes.fromhex(sys.argv[2]))
print(os.read(port, 300).hex())
"""


def test_programs_of_dialout_use_a_virtual_port(system: BootedSystem) -> None:
    """Also under the hardening of the unit, by a user that has no other right; a stop removes the link."""
    line = '[[line]]\nname = "old-hmi"\nport = "pty:ttyHMI"\nrole = "server"\nserves = "all"\n'
    system.write(FILE, CONFIG + line)
    start(system)
    link, request = "/run/modbus-gateway/ttyHMI", encode(200, bytes.fromhex("03 0000 0001")).hex()
    as_nobody = ["setpriv", "--reuid", "nobody", "--regid", "nogroup", "--groups"]
    program = [*as_nobody, "dialout", "python3", "-c", ON_A_VIRTUAL_PORT, link, request]
    for _ in range(3):
        answer = bytes.fromhex(system.done(*program))
        assert answer == encode(200, bytes.fromhex("03 02 0000"))
    assert system.run(*as_nobody, "nogroup", "python3", "-c", ON_A_VIRTUAL_PORT, link, request).returncode != 0
    stop(system)
    assert system.run("test", "-L", link).returncode != 0
