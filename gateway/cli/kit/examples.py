"""An example or more of each command, for its `--help` and for the manual page: what to type, and what it does."""

from collections.abc import Mapping
from typing import Final

EXAMPLES: Final[Mapping[str, tuple[tuple[str, str], ...]]] = {
    "demo": (
        ("demo", "simulated devices and a gateway, until Ctrl-C"),
        ("demo --once", "ask each device once, and check each answer"),
        ("demo --tls", "also with TLS: certificates, and a command to connect with them"),
    ),
    "run": (("run gateway.toml", "log on standard error, until Ctrl-C"),),
    "check": (
        ("check gateway.toml", "what is wrong, what each unit is, how long clients may wait"),
        ("check --json", "the config of the service, for a script"),
        ("check --schema > gateway.schema.json", "what an editor needs to complete and check the file"),
    ),
    "reload": (("reload", "apply changes of the config; connections stay open"),),
    "status": (
        ("status", "lines, units and clients at the moment"),
        ("status -w", "the same, every second"),
        ("status --fleet", "the sites of a fleet, those with trouble first"),
        ("status --fleet --csv > sites.csv", "the inventory of all sites, for a spreadsheet"),
    ),
    "values": (
        ("values", "what was last heard of each point of all devices"),
        ("values silo-1 -w", "of one device, again every second"),
        ("values --csv > values.csv", "for a spreadsheet"),
    ),
    "read": (
        ("read silo-1", "all points of a device"),
        ("read silo-1 weight -i 1s", "one point, every second"),
        ("read 46 holding 107-109", "registers 40108 to 40110 of unit 46: addresses count from 0"),
        ("read 46 holding 10 int32 --swap words", "a number in two registers, the low word first"),
        ("read 1 input 0-3 float32 --tcp 10.1.0.5", "ask any Modbus TCP server"),
        ("read 1 holding 0 float32 --port /dev/ttyUSB0 --baud 9600", "ask a device on a port without a gateway"),
        ("read 17 coils 0-15 --port /dev/ttyUSB0 --baud 9600 --format 8N1", "the same, in another character format"),
    ),
    "write": (
        ("write press register-40136 926 --show", "write a point, and show the old value and the new one"),
        ("write 17 coils 172 on", "switch a coil"),
        ("write silo-1 zero take", "write a point by one of its labels"),
        ("write boiler pump on", "one bit of a register"),
        ("write 46 holding 135 0x039E", "one register: function 06"),
        ("write 46 holding 135 10 258", "two registers: function 16"),
        ("write 46 holding 10 -2.5 float32 --swap words", "a number in two registers, the low word first"),
        ("write 17 coils 172 on --port /dev/ttyUSB0 --baud 9600", "on a port without a gateway"),
        ("write 1 holding 0 7 --tcp 10.1.0.5", "at any Modbus TCP server"),
    ),
    "ask": (
        ("ask", "all that a gateway can be asked, with the parameters"),
        ("ask unit unit=silo-1", "a unit with its points"),
        ("ask scan line=hall-a units=1-32", "several answers, each on a line of its own"),
        ("ask why who=silo-1 count=3", "the answer as JSON, for a script"),
    ),
    "forget": (("forget silo-1", "it was replaced, or set back by hand: it is at the address in the config"),),
    "scan": (
        ("scan hall-a", "all units that the config does not name, in the idle time of the line"),
        ("scan hall-a 1-32", "only these units"),
        ("scan --port /dev/ttyUSB0 --baud 9600", "on a port without a gateway"),
        ("scan 1-10 --port /dev/ttyUSB0 --all-speeds", "the same, at all usual rates"),
    ),
    "trace": (
        ("trace", "what passes on all lines, until Ctrl-C"),
        ("trace hall-a --unit silo-1", "of one line, and one unit"),
        ("trace hall-a --since 5min", "the frames of the last five minutes"),
        ("trace --why 46", "why requests to unit 46 failed"),
        ("trace --why 10.2.0.7", "why those of a client failed"),
        ("trace --why hall-a", "why those on a line failed"),
        ("trace --since 1h --pcapng hall.pcapng", "a file for Wireshark"),
        ("trace --pcapng - | wireshark -k -i -", "live in Wireshark"),
    ),
    "events": (
        ("events --since 24h --worst", "the warnings and errors of a day; what each means: docs/troubleshooting.md"),
        ("events -f --line hall-a", "what happens on a line, with its units and those who ask them, until Ctrl-C"),
        ("events --unit silo-1 --json", "the last events of a unit, for a script"),
    ),
    "calibrate": (
        ("calibrate silo-1 --for 10min", "how fast a device answers, and the limits that fit"),
        ("calibrate silo-1", "the same from the traffic since the start"),
        ("calibrate axis-1 --active --write 10-40", "write too: to these registers what they hold"),
        ("calibrate axis-1 --active --write-profile axis.toml", "read several sizes of its tables; make a profile"),
    ),
    "doctor": (
        ("doctor", "look at everything"),
        ("doctor hall-a", "what is wrong with a line, and the remedy"),
        ("doctor --passive", "what is wrong with all, and send nothing"),
        ("doctor --config gateway.toml", "the gateway with this config; or what can be seen while it does not run"),
        ("doctor --hardware-report /dev/ttyUSB0 --unit 1 --baud 9600", "what an adapter does, for a report"),
    ),
    "support": (
        (
            "support bundle.tar.gz",
            "config without secrets, status, findings, trace, versions, in one file; of the service with sudo",
        ),
        ("support bundle.tar.gz --no-trace", "the same without the values that passed on the lines"),
        ("support bundle.tar.gz --config gateway.toml", "of the gateway with this config; it need not run"),
    ),
    "bench": (
        ("bench hall-a", "read all units of a line in turn for a minute"),
        ("bench hall-a --unit silo-1 --items 20 --for 10s", "20 registers of one unit, for ten seconds"),
    ),
    "profile": (
        ("profile list weigh", "the kinds of devices that are known, with this word"),
        ("profile mint --baud 9600", "what one accepts, and its time limits at this rate"),
        ("profile add meter.toml", "check the file of a profile, and let every config use it"),
        ("profile mint --csv > mint.csv", "its points, for a spreadsheet"),
    ),
    "map": (
        ("map hall", "what stands at each address of a virtual unit, and where it comes from"),
        ("map 240 --csv > hall.csv", "the same for the one who sets up the SCADA"),
    ),
    "ports": (("ports", "serial ports, and the path of each for the config"),),
    "simulate": (
        ("simulate weigher:1 v80:6 --port /tmp/hall", "two devices on a virtual serial port"),
        ("simulate eastron-sdm630:1-3 --tcp 127.0.0.1:5502 --set 2:voltage-l1=207.5", "meters behind a server"),
        ("simulate my-meter --config gateway.toml --port /tmp/meter --set flow=invalid", "a profile of your own"),
        ("simulate mint:1-3 --port /tmp/axes --noise 5%", "three devices; some responses are damaged"),
    ),
    "import": (
        ("import mbusd /etc/mbusd/*.conf", "a config for all ports that mbusd serves"),
        ("import modbus-proxy modbus-proxy.yml", "a config with the same devices"),
        ("import home-assistant configuration.yaml", "the devices and entities of its modbus: section"),
        ("import csv registers.csv --name maker-kind", "a profile out of a table of registers"),
    ),
    "fleet": (
        ("fleet hub fleet.toml", "hub/hub.conf for nats-server, hub/SITE.creds for each site that has none"),
        ("fleet hub fleet.toml --renew plant-2", "a new key, when somebody else may have that of plant-2"),
    ),
    "user": (
        ("user add anna --role operator", "a user of the web page; asks for the password"),
        ("user add wall < password.txt", "reads the password from there"),
        ("user password anna", "set another password"),
        ("user remove anna", "remove her, and end her sessions"),
        ("user mes --token --role operator", "a program; prints its token, once"),
        ("user list", "who may log in, and programs"),
    ),
    "certificates": (
        ("certificates authority --name Plant-2", "an authority of one's own, for ten years"),
        ("certificates server gw.plant.example 10.2.0.5", "a certificate for a gateway by its name and its address"),
        ("certificates client hmi-3 --role operator", "one for a client, with the rights of its role"),
        ("certificates revoke hmi-3", "revoke all certificates of this client"),
        ("certificates revoke hmi-3 --replaced", "only those that --replace has replaced"),
    ),
    "completion": (("completion bash > ~/.local/share/bash-completion/completions/modbus-gateway", "for one user"),),
}


def examples_text(verb: str) -> str:
    """Show the examples of a command as in its `--help`; empty if there are none."""
    lines = [f"  modbus-gateway {words}\n      {what}" for words, what in EXAMPLES.get(verb, ())]
    return "\n".join([f"example{'' if len(lines) == 1 else 's'}:", *lines]) if lines else ""
