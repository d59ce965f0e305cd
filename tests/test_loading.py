"""What a program loads with the public names: no more than it uses. Time would depend on the machine."""

import json
import subprocess
import sys

#: What each of these imports would cost a program that never asks for it.
OF_ADD_ONS = {"aiohttp", "jinja2", "nacl", "nats", "paho", "prometheus_client", "pymodbus", "ruamel", "structlog"}


def loaded(statement: str) -> set[str]:
    """The modules that a statement loads, in a process of its own."""
    script = f"import json, sys; old = {{*sys.modules}}; {statement}; print(json.dumps([*{{*sys.modules}} - old]))"
    return {*json.loads(subprocess.run([sys.executable, "-P", "-c", script], capture_output=True, check=True).stdout)}


def test_the_package_alone_loads_nothing_but_its_version():
    more = loaded("import gateway") - loaded("import importlib")
    assert more == {"gateway", "gateway.version"}


def test_a_custom_unit_needs_neither_a_loop_nor_a_config():
    more = loaded("from gateway import Area, CustomUnit, IllegalAddress")
    assert {name for name in more if name.startswith("gateway")} == {
        *("gateway", "gateway.version", "gateway.errors", "gateway.images", "gateway.images.custom_unit"),
        *("gateway.modbus", "gateway.modbus.codes"),
    }
    assert more & {"asyncio", "dataclasses", "logging", "pydantic", "socket", "ssl"} == set()


def test_a_gateway_loads_no_library_of_what_its_config_may_not_have():
    more = loaded("from gateway import Gateway, UnitClient, Reading, events")
    assert more & OF_ADD_ONS == set()
    assert "gateway.web" not in more
