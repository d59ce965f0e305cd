"""A real gateway and a real broker: losses of either, commands that must not be carried out, TLS, passwords."""

import json
import re
import signal
import ssl
import subprocess
import time
from collections.abc import Callable, Collection
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from kit.device import SimulatedDevice, SimulatedLine
from kit.free_port import free_port
from kit.mosquitto import Mosquitto, OlderBroker, Subscriber, WebSocketDoor
from kit.pki import pki
from kit.process import PATIENCE, GatewayProcess, command
from kit.pty import VirtualPort
from kit.serial_line import SerialDevices

pytestmark = pytest.mark.needs("mosquitto", "mosquitto_sub")
DEPLOY = Path(__file__).parents[2] / "deploy" / "mosquitto"

PROFILE = """
[profile.scale]
points = [
  { name = "weight", holding = 0, type = "float32", unit = "kg" },
  { name = "state", holding = 2, labels = { 0 = "off", 1 = "on" }, write = true },
  { name = "number", holding = 10, write = true },
]
"""
IMAGE = """
[[image]]
unit    = 9
name    = "shift"
profile = "scale"
holding = 20
"""
MIRROR = """
[[image]]
unit = {unit}
of   = "{of}"
read = [{{ holding = "0-2", every = "100 ms" }}, {{ holding = "10", every = "100 ms" }}]
"""
SITE = 'site = "plant-2"\n[[listen]]\nbind = "tcp://127.0.0.1:0"\n'
SHIFT = "modbus/plant-2/shift"
STATUS = "modbus/plant-2/status"


def mqtt(port: int, *keys: str, scheme: str = "mqtt", device: str = "shift") -> str:
    row = f'publish = [{{ device = "{device}", every = "100 ms" }}]'
    return "\n".join(["[mqtt]", f'broker = "{scheme}://127.0.0.1:{port}"', row, *keys])


def config(port: int, *keys: str, scheme: str = "mqtt") -> str:
    return SITE + IMAGE + PROFILE + mqtt(port, *keys, scheme=scheme)


def four_devices(folder: Path, line: str, name: str, first: int = 1) -> str:
    """A line with the units 1 to 4, whose clients know them by numbers from `first` on."""
    rows = (
        f'{{ unit = {unit}, as = {first + unit - 1}, name = "{name}-{unit}", profile = "scale" }}'
        for unit in range(1, 5)
    )
    keys = f'name = "{line}"\nport = "{folder}/{line}"\nbaud = 115200\nwire = "direct"\ntimeout = "20 s"'
    return f"[[line]]\n{keys}\ndevices = [{', '.join(rows)}]\n"


def write(gateway: GatewayProcess, *words: str) -> None:
    """Write into a unit as an operator does."""
    done = command("write", *words, "--control", str(gateway.config.parent / "control.sock"))
    assert done.returncode == 0, done.stderr


def until(is_so: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not is_so():
        assert time.monotonic() < deadline
        time.sleep(0.05)


@contextmanager
def running(folder: Path, text: str):
    (folder / "state").mkdir(exist_ok=True)
    with GatewayProcess(folder, text + f'\n[control]\nsocket = "{folder}/control.sock"\n') as gateway:
        yield gateway


def test_values_are_published_and_a_stop_says_good_bye(tmp_path):
    with (
        Mosquitto(tmp_path) as broker,
        running(tmp_path, config(broker.port)) as gateway,
        Subscriber(broker) as subscriber,
    ):
        assert gateway.wait_for("broker_up")["version"] == "5"
        subscriber.wait_for(STATUS, "online")
        write(gateway, "shift", "number", "77")
        found = subscriber.wait_for(SHIFT, number=77)
        assert found.content.keys() == {"time", "weight", "state", "number"}
        assert gateway.stop() == 0
        subscriber.wait_for(STATUS, "offline")
        with Subscriber(broker) as late:
            late.wait_until(lambda: late.latest.keys() >= {STATUS, SHIFT, f"{SHIFT}/availability"})
            assert late.latest[STATUS] == "offline"
            assert late.latest[f"{SHIFT}/availability"] == "online"
            assert '"number": 77' in late.latest[SHIFT]
            assert all(each.retained for each in late.heard)


def test_after_kill_9_the_broker_says_that_the_gateway_is_gone(tmp_path):
    with Mosquitto(tmp_path) as broker, Subscriber(broker) as subscriber:
        with running(tmp_path, config(broker.port)) as gateway:
            subscriber.wait_for(STATUS, "online")
            gateway.signal(signal.SIGKILL)
            subscriber.wait_for(STATUS, "offline")
        with Subscriber(broker) as late:
            assert late.wait_for(STATUS) == (STATUS, "offline", True)
        with running(tmp_path, config(broker.port)):
            subscriber.wait_for(STATUS, "online")


def test_a_broker_that_was_killed_under_load_has_the_last_values_when_it_is_back(tmp_path):
    """Devices count on while it is away; nothing is kept but the last values, and these are there afterwards.

    They are read all the time as often as those of mirrors on a line like theirs, of which no broker knows.
    """
    with ExitStack() as stack:
        hall, yard = (stack.enter_context(VirtualPort(tmp_path / name)) for name in ("hall", "yard"))
        devices, mirrored = ([SimulatedDevice(unit, delay=0.001) for unit in range(1, 5)] for _ in range(2))
        lines = {hall: SimulatedLine("rtu", *devices), yard: SimulatedLine("rtu", *mirrored)}
        stack.enter_context(SerialDevices(lines))
        broker = stack.enter_context(Mosquitto(tmp_path))
        text = SITE + four_devices(tmp_path, "hall", "silo") + four_devices(tmp_path, "yard", "tank", first=11)
        mirrors = "".join(MIRROR.format(unit=20 + unit, of=f"tank-{unit}") for unit in range(1, 5))
        publishing = mqtt(broker.port, device="silo-*")
        gateway = stack.enter_context(running(tmp_path, text + mirrors + PROFILE + publishing))
        gateway.wait_for("broker_up")

        def asked(of: list[SimulatedDevice]) -> int:
            return sum(len(device.heard) for device in of)

        def count_on(seconds: float) -> None:
            for device in devices:
                device.holding[10] = (device.holding[10] + 1) % 65536
            time.sleep(seconds)

        def read(times: int) -> None:
            """Let the values count on until mirrors have asked each device so often; see how often others were."""
            began = time.monotonic()
            published, polled = asked(devices), asked(mirrored)
            while asked(mirrored) < polled + times * len(mirrored):
                assert time.monotonic() < began + PATIENCE, "nothing is polled"
                count_on(0.02)
            published, polled = asked(devices) - published, asked(mirrored) - polled
            assert published > polled / 2, "the lines are not read as before"  # on a busy machine these may begin later
            # Two requests of each device at each tenth of a second; one of each may be left from before.
            assert published <= 2 * len(devices) * (10 * (time.monotonic() - began) + 2)

        for _ in range(3):
            read(10)
            broker.kill()
            gateway.wait_for("broker_lost")
            read(40)
            broker.start()
            gateway.wait_for("broker_up")
        read(10)
        last = [device.holding[10] for device in devices]
        with Subscriber(broker) as subscriber:
            expected = {f"modbus/plant-2/silo-{unit}": value for unit, value in enumerate(last, start=1)}
            subscriber.wait_until(lambda: numbers(subscriber, expected) == expected)


def numbers(subscriber: Subscriber, topics: Collection[str]) -> dict[str, int]:
    """What was last published as `number` on these topics."""
    latest = subscriber.latest
    return {topic: json.loads(latest[topic]).get("number") for topic in topics if topic in latest}


def test_a_value_is_written_and_one_that_is_retained_or_repeated_never(tmp_path):
    with Mosquitto(tmp_path) as broker:
        topic, result = f"{SHIFT}/state/set", f"{SHIFT}/state/result"
        broker.publish(topic, "on", "-r")  # it was there before the gateway
        with Subscriber(broker) as subscriber, running(tmp_path, config(broker.port, "write = true")) as gateway:
            refused = subscriber.wait_for(result)
            assert (refused.content["result"], refused.content["reason"][:14]) == ("failed", "it is retained")
            broker.publish(topic, "on", "-r", "-V", "mqttv5")  # and comes again while it is there
            assert subscriber.wait_for(result).content["result"] == "failed"
            repeated = ("-V", "mqttv5", "-D", "publish", "correlation-data", "7")
            broker.publish(topic, "on", *repeated)
            done = subscriber.wait_for(result).content
            assert (done["value"], done["result"]) == ("on", "ok")
            subscriber.wait_for(SHIFT, state="on")
            write(gateway, "shift", "state", "off")
            subscriber.wait_for(SHIFT, state="off")
            broker.publish(topic, "on", *repeated)
            assert subscriber.wait_for(result).content["reason"] == "one with this correlation was received before"
            broker.publish(f"{SHIFT}/weight/set", "1")
            assert subscriber.wait_for(f"{SHIFT}/weight/result").content["reason"] == "weight must not be written"
            broker.publish(topic, "blue")
            assert "is not a number" in subscriber.wait_for(result).content["reason"]
            assert gateway.stop() == 0
            audits = [event for event in gateway.log if event["event"] == "write_audit"]
            written = [each["client"] for each in audits if each["result"] == "ok"]
            assert written == ["mqtt", "control"]
            assert {each["client"] for each in audits if each["result"] == "refused"} == {"mqtt"}
        assert '"state": "off"' in subscriber.latest[SHIFT]


def test_over_tls_with_a_certificate_of_its_own(tmp_path):
    folder = pki()
    settings = (
        f"cafile {folder}/ca.crt",
        f"certfile {folder}/server.crt",
        f"keyfile {folder}/server.key",
        "require_certificate true",
    )
    own = (f'ca = "{folder}/ca.crt"', f'certificate = "{folder}/operator.crt"', f'key = "{folder}/operator.key"')
    options = ("--cafile", f"{folder}/ca.crt", "--cert", f"{folder}/operator.crt", "--key", f"{folder}/operator.key")
    with (
        Mosquitto(tmp_path, *settings) as broker,
        running(tmp_path, config(broker.port, *own, scheme="mqtts")) as gateway,
        Subscriber(broker, "#", ("-h", "127.0.0.1", *options)) as subscriber,
    ):
        assert gateway.wait_for("broker_up")["broker"] == f"mqtts://127.0.0.1:{broker.port}"
        subscriber.wait_for(STATUS, "online")


@pytest.mark.parametrize("key", ['ca = "{folder}/ca.crt"', ""])
def test_a_broker_that_cannot_be_trusted_gets_nothing(tmp_path, key):
    folder = pki()
    settings = (f"certfile {folder}/server.crt", f"keyfile {folder}/server.key")
    name = 'server_name = "elsewhere.example"' if key else ""
    keys = (key.format(folder=folder), name)
    with Mosquitto(tmp_path, *settings) as broker, running(tmp_path, config(broker.port, *keys, scheme="mqtts")) as it:
        assert "certificate is refused" in it.wait_for("broker_lost")["reason"]
        assert "mbgw-plant-2" not in broker.log


def test_a_wrong_password_is_told_and_the_right_one_taken_without_a_restart(tmp_path):
    users, password = tmp_path / "users", tmp_path / "password"
    subprocess.run(["mosquitto_passwd", "-b", "-c", str(users), "gw", "right"], check=True, capture_output=True)
    password.write_text("wrong\n")
    password.chmod(0o600)
    keys = ('user = "gw"', f'password = {{ file = "{password}" }}')
    with (
        Mosquitto(tmp_path, f"password_file {users}", anonymous=False) as broker,
        running(tmp_path, config(broker.port, *keys)) as gateway,
    ):
        lost = gateway.wait_for("broker_lost")
        assert lost["reason"] == "user or password is wrong, or this user may not connect"
        password.write_text("right\n")
        gateway.wait_for("broker_up")


def test_our_config_of_the_broker_works_beside_that_of_debian(tmp_path):
    ours = (DEPLOY / "mosquitto.conf").read_text(encoding="utf-8").replace("listener 1883", f"listener {free_port()}")
    files = {"password_file": tmp_path / "passwords", "acl_file": DEPLOY / "acl"}
    for key, file in files.items():
        ours = re.sub(rf"^{key} .*", f"{key} {file}", ours, flags=re.MULTILINE)
    added = tmp_path / "conf.d" / "modbus-gateway.conf"
    added.parent.mkdir()
    added.write_text(ours)
    files["password_file"].touch()
    logins = {user: ("-u", user, "-P", "right") for user in ("plant-2", "telegraf", "homeassistant")}
    for user in logins:
        make = ["mosquitto_passwd", "-b", str(files["password_file"]), user, "right"]
        subprocess.run(make, check=True, capture_output=True)
    debian = (
        f"pid_file {tmp_path}/mosquitto.pid",
        "persistence true",
        f"persistence_location {tmp_path}/",
        f"include_dir {added.parent}",
    )
    with Mosquitto(tmp_path, *debian) as broker:
        broker.publish(STATUS, "online", *logins["plant-2"])
        with pytest.raises(subprocess.CalledProcessError):
            broker.publish(STATUS, "online")
        for user in "telegraf", "plant-2":
            broker.publish(f"homeassistant/device/{user}/silo/config", "{}", "-r", *logins[user])
        with Subscriber(broker, "modbus/#", logins["telegraf"]) as reader:
            for user in "telegraf", "plant-2":
                broker.publish(f"modbus/plant-2/{user}/history", "[]", *logins[user])
            reader.wait_for("modbus/plant-2/plant-2/history")
            assert "modbus/plant-2/telegraf/history" not in reader.latest, "who reads publishes nothing"
        with Subscriber(broker, "homeassistant/#", logins["homeassistant"]) as announced:
            announced.wait_for("homeassistant/device/plant-2/silo/config")
            broker.publish("homeassistant/status", "online", *logins["homeassistant"])
            announced.wait_for("homeassistant/status")
            assert "homeassistant/device/telegraf/silo/config" not in announced.latest, "who reads announces nothing"


@pytest.mark.parametrize(("keys", "who"), [(('user = "gw"',), 'user "gw"'), ((), "a client without a user")])
def test_without_the_right_to_publish_it_is_told_who_may_not_publish_where(tmp_path, keys, who):
    rights = tmp_path / "acl"
    rights.write_text("topic read #\n")
    with Mosquitto(tmp_path, f"acl_file {rights}") as broker, running(tmp_path, config(broker.port, *keys)) as gateway:
        reason = gateway.wait_for("broker_refused")["reason"]
        assert reason.startswith(f"{who} may not publish to modbus/plant-2/")
        assert gateway.wait_for("broker_lost")["reason"] == f"{who} may not publish to {STATUS}"
        rights.write_text("pattern readwrite #\n")
        broker.reload()
        gateway.wait_for("broker_up")
        assert [event["event"] for event in gateway.log].count("broker_refused") == 1


def test_without_write_a_value_gets_a_result_that_says_so(tmp_path):
    with (
        Mosquitto(tmp_path) as broker,
        running(tmp_path, config(broker.port)) as gateway,
        Subscriber(broker) as subscriber,
    ):
        gateway.wait_for("broker_up")
        broker.publish(f"{SHIFT}/state/set", "on")
        reason = "state must not be written: the gateway's [mqtt] has no write = true"
        assert subscriber.wait_for(f"{SHIFT}/state/result").content["reason"] == reason
        assert gateway.wait_for("command_refused")["reason"] == reason


def test_a_password_that_others_can_read_is_not_used(tmp_path):
    password = tmp_path / "password"
    password.write_text("right\n")
    password.chmod(0o644)
    keys = ('user = "gw"', f'password = {{ file = "{password}" }}')
    with Mosquitto(tmp_path) as broker, running(tmp_path, config(broker.port, *keys)) as gateway:
        assert gateway.wait_for("broker_lost")["reason"].endswith(f"chmod o=,g-w {password}")


def test_a_broker_with_an_older_version_of_mqtt_will_do(tmp_path):
    with (
        Mosquitto(tmp_path) as broker,
        OlderBroker(broker.port) as older,
        running(tmp_path, config(older.port, "write = true")) as gateway,
        Subscriber(broker) as subscriber,
    ):
        assert "does not have this version" in gateway.wait_for("broker_lost")["reason"]
        assert gateway.wait_for("broker_up")["version"] == "3.1.1"
        subscriber.wait_for(STATUS, "online")
        broker.publish(f"{SHIFT}/state/set", "on")
        subscriber.wait_for(SHIFT, state="on")


def test_over_websockets(tmp_path):
    with (
        Mosquitto(tmp_path) as broker,
        WebSocketDoor(broker.port) as door,
        running(tmp_path, config(door.port, scheme="ws")) as gateway,
    ):
        gateway.wait_for("broker_up")


def test_over_encrypted_websockets_with_a_password_that_systemd_hands_over(tmp_path, monkeypatch):
    folder, credentials, users = pki(), tmp_path / "credentials", tmp_path / "users"
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.load_cert_chain(folder / "server.crt", folder / "server.key")
    subprocess.run(["mosquitto_passwd", "-b", "-c", str(users), "gw", "right"], check=True, capture_output=True)
    credentials.mkdir()
    (credentials / "mqtt").write_text("right\n")
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(credentials))
    keys = (f'ca = "{folder}/ca.crt"', 'user = "gw"', 'password = { credential = "mqtt" }', "write = true")
    login = ("-u", "gw", "-P", "right")
    with (
        Mosquitto(tmp_path, f"password_file {users}", anonymous=False) as broker,
        WebSocketDoor(broker.port, context) as door,
        running(tmp_path, config(door.port, *keys, scheme="wss")) as gateway,
        Subscriber(broker, "#", login) as subscriber,
    ):
        assert gateway.wait_for("broker_up")["broker"] == f"wss://127.0.0.1:{door.port}/mqtt"
        for number in range(20):  # several may lie in one record, which select does not tell
            broker.publish(f"{SHIFT}/number/set", str(number), *login)
        subscriber.wait_for(SHIFT, number=19)


def test_a_broker_that_is_not_there_keeps_nobody_waiting(tmp_path):
    port = free_port()
    with running(tmp_path, config(port)) as gateway:
        assert "refused" in gateway.wait_for("broker_lost")["reason"]
        began = time.monotonic()
        assert gateway.stop() == 0
        assert time.monotonic() - began < PATIENCE / 2
        assert [event["event"] for event in gateway.log].count("broker_lost") == 1


def test_a_reload_publishes_other_points_and_ends_without_the_table(tmp_path):
    with Mosquitto(tmp_path) as broker, Subscriber(broker) as subscriber:
        text = config(broker.port)
        with running(tmp_path, text) as gateway:
            subscriber.wait_for(STATUS, "online")
            written = gateway.config.read_text()
            gateway.config.write_text(written.replace('device = "shift",', 'device = "shift", points = ["number"],'))
            gateway.signal(signal.SIGHUP)
            assert gateway.wait_for("config_applied")["changed"] == ["mqtt"]
            subscriber.wait_for(STATUS, "online")
            write(gateway, "shift", "number", "5")
            assert subscriber.wait_for(SHIFT, number=5).content.keys() == {"time", "number"}
            start = written.index("[mqtt]")
            gateway.config.write_text(written[:start] + written[written.index("[control]") :])
            gateway.signal(signal.SIGHUP)
            assert gateway.wait_for("config_applied")["removed"] == ["mqtt"]
            subscriber.wait_for(STATUS, "offline")
            assert gateway.stop() == 0


def test_of_two_gateways_with_one_site_each_says_that_there_is_another(tmp_path):
    folders = [tmp_path / name for name in ("one", "other")]
    for folder in folders:
        folder.mkdir()
    with Mosquitto(tmp_path) as broker, running(folders[0], config(broker.port)) as one:
        one.wait_for("broker_up")
        with running(folders[1], config(broker.port)) as other:
            for gateway in (one, other):
                while "another client uses the same name" not in gateway.wait_for("broker_lost")["reason"]:
                    pass  # not every broker says so the first time
            control = ("--control", str(one.config.parent / "control.sock"))
            until(lambda: "another client uses the same name" in command("doctor", "--passive", *control).stdout)
            until(lambda: "another client uses the same name" in command("status", *control).stdout)
