"""Configs go out to three gateways by deploy/ansible: checked everywhere first, then one host after the other.

    .venv/bin/python tests/soak/rollout.py

Needs `apt install ansible-core`; where `ansible-lint` is, it checks the playbook as well. Rollouts that work,
one in which the check of the second host refuses its file, and one in which a line of the second host does not come up
again. After each, the file of every host and the units of its gateway are compared with what they must be.
"""

import json
import os
import shutil
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from kit.process import COMMAND, GatewayProcess, simulated

PLAYBOOKS = Path(__file__).resolve().parents[2] / "deploy" / "ansible"
HOSTS = ("north", "middle", "south")
CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name    = "hall"
port    = "{port}"
baud    = 19200
devices = [{{ unit = {unit}, name = "meter" }}]
"""
WORKS, REFUSED, STAYS_DOWN = "works", "is refused", "stays down"


class Host(NamedTuple):
    """A host of the inventory: a folder of this machine, and the gateway that runs there."""

    name: str
    folder: Path
    gateway: GatewayProcess

    @property
    def config(self) -> str:
        return self.gateway.config.read_text()

    @property
    def units(self) -> list[int]:
        """Of the line, as the running gateway has them."""
        told = subprocess.run(
            [self.folder / "program", "status", "--json"], capture_output=True, check=True, timeout=60
        )
        return [unit["unit"] for unit in json.loads(told.stdout)["units"]]


def make_host(name: str, folder: Path, stack: ExitStack) -> Host:
    folder.mkdir()
    stack.enter_context(simulated(folder / "port", "generic:1-9"))
    gateway = stack.enter_context(GatewayProcess(folder, CONFIG.format(port=folder / "port", unit=1)))
    words = " ".join(f"'{word}'" for word in COMMAND)
    program = folder / "program"
    paths = f"RUNTIME_DIRECTORY='{folder}' STATE_DIRECTORY='{folder}' PYTHONPATH='{os.environ.get('PYTHONPATH', '')}'"
    program.write_text(f'#!/bin/sh\n{paths} exec {words} "$@"\n')
    program.chmod(0o755)
    return Host(name, folder, gateway)


def write_inventory(playbooks: Path, hosts: list[Host]) -> None:
    """One with all hosts on this machine, and without other rights."""
    told = {
        host.name: {
            "ansible_connection": "local",
            "ansible_become": False,
            "ansible_python_interpreter": "/usr/bin/python3",
            "modbus_gateway_program": str(host.folder / "program"),
            "modbus_gateway_config": str(host.gateway.config),
            "modbus_gateway_patience": 3,
        }
        for host in hosts
    }
    (playbooks / "hosts.yml").write_text(json.dumps({"gateways": {"hosts": told}}))


def roll_out(playbooks: Path, hosts: list[Host], unit: int, middle: str) -> bool:
    """Give all hosts configs with this unit; `middle` is what becomes of the second one. Whether it succeeds."""
    for host in hosts:
        text = CONFIG.format(port=host.folder / "port", unit=unit) + '[log]\nformat = "json"\nlevel = "debug"\n'
        if host.name == "middle" and middle == REFUSED:
            text = text.replace("baud ", "bauds")
        if host.name == "middle" and middle == STAYS_DOWN:
            text = text.replace(str(host.folder / "port"), str(host.folder / "nothing"))
        (playbooks / "configs" / f"{host.name}.toml").write_text(text)
    command = ["ansible-playbook", "--inventory", "hosts.yml", "gateways.yml"]
    env = {**os.environ, "LC_ALL": "C.UTF-8", "ANSIBLE_NOCOLOR": "1", "ANSIBLE_HOME": str(playbooks / "home")}
    done = subprocess.run(command, cwd=playbooks, env=env, capture_output=True, text=True, timeout=600, check=False)
    print(done.stdout.partition("PLAY RECAP")[2] or done.stdout + done.stderr)
    return done.returncode == 0


def expect(hosts: list[Host], *units: int) -> None:
    """Each host has this unit, in its file and in its gateway."""
    for host, unit in zip(hosts, units, strict=True):
        assert f"unit = {unit}," in host.config, (host.name, host.config)
        assert host.units == [unit], (host.name, host.units, unit)
        assert "nothing" not in host.config


def main() -> None:
    lint = shutil.which("ansible-lint")
    if lint:
        subprocess.run([lint, "--offline", "--nocolor", "gateways.yml"], cwd=PLAYBOOKS, check=True)
    with TemporaryDirectory() as temporary, ExitStack() as stack:
        folder = Path(temporary)
        playbooks = folder / "playbooks"
        shutil.copytree(PLAYBOOKS, playbooks)
        hosts = [make_host(name, folder / name, stack) for name in HOSTS]
        write_inventory(playbooks, hosts)

        assert roll_out(playbooks, hosts, 2, WORKS)
        expect(hosts, 2, 2, 2)
        assert not roll_out(playbooks, hosts, 3, REFUSED)
        expect(hosts, 2, 2, 2)
        assert not roll_out(playbooks, hosts, 4, STAYS_DOWN)
        expect(hosts, 4, 2, 2)
        assert roll_out(playbooks, hosts, 5, WORKS)
        expect(hosts, 5, 5, 5)
    print("all hosts had what they must have after each rollout")


if __name__ == "__main__":
    main()
