"""What a program loads with the public names: no more than it uses. Time would depend on the machine."""

import json
import subprocess
import sys
from pathlib import Path

#: What each of these imports would cost a program that never asks for it.
OF_ADD_ONS = {"aiohttp", "jinja2", "nacl", "nats", "paho", "prometheus_client", "pymodbus", "ruamel", "structlog"}


def loaded(statement: str) -> set[str]:
    """The modules that a statement loads, in a process of its own."""
    script = f"import json, sys; old = {{*sys.modules}}\n{statement}\nprint(json.dumps([*{{*sys.modules}} - old]))"
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


MINIMAL = '[[line]]\nport = "/dev/ttyUSB0"\ndevices = [{ unit = 1 }]\n'
#: The most modules that a minimal config takes, without those of Python's own library, which differ between versions.
#: To load one takes a third of a millisecond, and more with dataclasses in it.
MOST_FOR_CHECK, MOST_FOR_READING = 340, 278
_TOO_MANY = (
    "{} modules are loaded, and this bound keeps starts short: import what only some configs need where they need it, "
    "put what is shared with others into a module of its own, or argue for a higher bound"
)


def test_check_loads_only_what_a_minimal_config_needs(tmp_path: Path) -> None:
    file = tmp_path / "gateway.toml"
    file.write_text(MINIMAL)
    more = loaded(
        "import contextlib, io; from gateway.cli.main import main\n"
        f"with contextlib.redirect_stdout(io.StringIO()): main(['check', {str(file)!r}])"
    )
    assert more & {*OF_ADD_ONS, "asyncio", "sqlite3", "ssl", "serial"} == set()
    assert len(others := not_of_python(more)) <= MOST_FOR_CHECK, _TOO_MANY.format(len(others))


def test_the_process_that_reads_a_config_loads_only_what_a_minimal_one_needs(tmp_path: Path) -> None:
    file = tmp_path / "gateway.toml"
    file.write_text(MINIMAL)
    more = loaded(
        "from pathlib import Path; from gateway.readconfig.reader import packed, read_here\n"
        f"packed(read_here(Path({str(file)!r})))"
    )
    assert more & {*OF_ADD_ONS, "asyncio", "sqlite3", "ssl", "serial"} == set()
    assert len(others := not_of_python(more)) <= MOST_FOR_READING, _TOO_MANY.format(len(others))


def not_of_python(modules: set[str]) -> set[str]:
    return {name for name in modules if name.partition(".")[0] not in sys.stdlib_module_names}
