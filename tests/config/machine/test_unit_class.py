"""The class of a unit that is made in Python: where it is found, and what is said if it cannot be used."""

import sys
from textwrap import dedent
from threading import Event
from types import SimpleNamespace

import pytest

from gateway.config.machine import unit_class
from gateway.config.machine.unit_class import find_class, unit_trouble
from kit.process import PATIENCE


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder beside no other; what is imported from it is forgotten afterwards."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    before = {*sys.modules}
    yield tmp_path
    for name in {*sys.modules} - before:
        del sys.modules[name]


CLOCK = """\
    from gateway import CustomUnit

    class Clock(CustomUnit):
        async def read(self, area, address, count):
            return [1] * count
"""


def write(folder, text=CLOCK, name="clock_a"):
    (folder / f"{name}.py").write_text(dedent(text))


def said(folder, python):
    """What is said of a class, without the folder."""
    trouble = unit_trouble(python, folder)
    assert trouble is not None
    told = f"{trouble} | {trouble.remedy}" if trouble.remedy else str(trouble)
    return told.replace(str(folder), "FOLDER").replace(sys.executable, "PYTHON")


def test_a_module_beside_the_config_is_found_and_may_be_used(folder):
    write(folder)
    assert unit_trouble("clock_a:Clock", folder) is None
    assert find_class("clock_a:Clock", folder).__module__ == "clock_a"


def test_what_is_installed_comes_before_what_is_beside_the_config(folder, tmp_path_factory):
    installed = tmp_path_factory.mktemp("installed")
    sys.path.insert(0, str(installed))
    write(installed)
    write(folder, "Clock = None\n")
    assert unit_trouble("clock_a:Clock", folder) is None


def test_a_module_of_a_package_beside_the_config(folder):
    (folder / "works").mkdir()
    write(folder / "works", CLOCK, "clock_b")
    assert unit_trouble("works.clock_b:Clock", folder) is None


def test_what_a_module_imports_later_is_found_too(folder):
    write(folder, CLOCK + "\n    def later():\n        import clock_c\n        return clock_c\n")
    write(folder, "", "clock_c")
    find_class("clock_a:Clock", folder)
    assert sys.modules["clock_a"].later().__name__ == "clock_c"


def test_a_module_that_was_just_copied_there_is_found(folder):
    assert "there is no module clock_a" in said(folder, "clock_a:Clock")
    write(folder)
    assert unit_trouble("clock_a:Clock", folder) is None


def test_what_a_module_prints_is_no_answer_of_a_command(folder, capsys):
    write(folder, "print('hello')\n" + dedent(CLOCK))
    assert unit_trouble("clock_a:Clock", folder) is None
    assert capsys.readouterr() == ("", "hello\n")


@pytest.mark.parametrize(
    ("python", "told"),
    [
        (
            "clock_x:Clock",
            'there is no module clock_x: neither installed for PYTHON nor in FOLDER | did you mean "clock_a"?',
        ),
        (
            "zzz.b:Clock",
            "there is no module zzz: neither installed for PYTHON nor in FOLDER | known here: clock_a",
        ),
        ("clock_a:Clok", 'clock_a has no class Clok (FOLDER/clock_a.py) | did you mean "Clock"?'),
        ("sys:Clock", "sys has no class Clock (it is a part of Python)"),
    ],
)
def test_a_name_that_leads_to_nothing(folder, python, told):
    write(folder)
    assert said(folder, python) == told


def test_a_folder_without_modules(folder):
    assert said(folder, "clock_x:Clock").endswith("nor in FOLDER | put clock_x.py beside the config")


@pytest.mark.parametrize(
    ("module", "told"),
    [
        (
            "def f():\n    raise ValueError('bad\\nnews')\n\nf()\n",
            r"clock_a cannot be imported: ValueError: bad\nnews (FOLDER/clock_a.py, line 2)",
        ),
        (
            "wrong = ValueError('no port')\nwrong.add_note('at the clock')\nraise wrong\n",
            "clock_a cannot be imported: ValueError: no port (FOLDER/clock_a.py, line 3)",
        ),
        ("def (\n", "clock_a cannot be imported: SyntaxError: invalid syntax (FOLDER/clock_a.py, line 1)"),
        ("exit(1)\n", "clock_a cannot be imported: SystemExit: 1"),
        (
            "import json\njson.loads('')\n",
            "clock_a cannot be imported: JSONDecodeError: Expecting value: line 1 column 1 (char 0)",
        ),
        (
            "import no_such_library\n",
            (
                "clock_a cannot be imported: ModuleNotFoundError: No module named 'no_such_library' "
                "(FOLDER/clock_a.py, line 1) | install it for the Python of the gateway, PYTHON"
            ),
        ),
        (
            "from gateway import CustomUnits\n",
            "clock_a cannot be imported: ImportError: cannot import name 'CustomUnits' from 'gateway'",
        ),
    ],
)
def test_a_module_whose_code_fails_is_told_in_one_line(folder, module, told):
    write(folder, module)
    assert said(folder, "clock_a:Clock").startswith(told)
    assert "\n" not in said(folder, "clock_a:Clock")


def test_what_a_module_needs_is_put_beside_the_config_where_nothing_else_is_found(folder, monkeypatch):
    monkeypatch.setattr(sys, "path", [each for each in sys.path if "-packages" not in each])
    write(folder, "import no_such.library\n")
    assert said(folder, "clock_a:Clock").endswith(" | pip install --target FOLDER no_such")


@pytest.mark.parametrize(
    ("unit", "told"),
    [
        (
            "Clock = 1",
            (
                "clock_a:Clock is not a subclass of CustomUnit (FOLDER/clock_a.py) "
                "| from gateway import CustomUnit, and write it as class Clock(CustomUnit)"
            ),
        ),
        ("class Clock: pass", "clock_a:Clock is not a subclass of CustomUnit"),
        ("Clock = CustomUnit", "clock_a:Clock is not a subclass of CustomUnit"),
        (
            "class Clock(CustomUnit): pass",
            (
                "clock_a:Clock has neither read nor write (FOLDER/clock_a.py) "
                "| write async def read(self, area, address, count)"
            ),
        ),
        (
            "class Clock(CustomUnit):\n    def read(self, area, address, count): return [1]",
            (
                "clock_a:Clock has a read that is not async (FOLDER/clock_a.py) "
                "| write async def read(self, area, address, count)"
            ),
        ),
        (
            "class Clock(CustomUnit):\n    async def write(self, area, address): pass",
            (
                "clock_a:Clock has a write with other parameters, (self, area, address) (FOLDER/clock_a.py) "
                "| write async def write(self, area, address, values)"
            ),
        ),
        (
            "class Clock(CustomUnit):\n    async def read(self, area, address, count, more): return []",
            "clock_a:Clock has a read with other parameters, (self, area, address, count, more)",
        ),
        (
            (
                "class Clock(CustomUnit):\n    def __init__(self, port): pass\n"
                "    async def read(self, area, address, count): return [1]"
            ),
            (
                "clock_a:Clock needs arguments, (port) (FOLDER/clock_a.py) "
                "| give them defaults: it is made without arguments"
            ),
        ),
        (
            (
                "from abc import ABC, abstractmethod\nclass Clock(CustomUnit, ABC):\n"
                "    @abstractmethod\n    def now(self): pass\n"
                "    async def read(self, area, address, count): return [1]"
            ),
            "clock_a:Clock has no now (FOLDER/clock_a.py) | write it",
        ),
    ],
)
def test_a_class_that_cannot_be_a_unit(folder, unit, told):
    write(folder, f"from gateway import CustomUnit\n{unit}\n")
    assert said(folder, "clock_a:Clock").startswith(told)


def test_parameters_with_defaults_and_other_names_are_no_trouble(folder):
    unit = "def __init__(self, port=1): pass\n    async def read(self, a, b, c, *more, d=1): return [1]"
    write(folder, f"from gateway import CustomUnit\nclass Clock(CustomUnit):\n    {unit}\n")
    assert unit_trouble("clock_a:Clock", folder) is None


def test_a_method_with_a_decorator_is_what_it_decorates(folder):
    decorated = """\
        from functools import wraps
        from gateway import CustomUnit

        def counted(call):
            @wraps(call)
            def counting(*words):
                return call(*words)
            return counting

        class Clock(CustomUnit):
            @counted
            async def read(self, area, address, count): return [1]
    """
    write(folder, decorated)
    assert unit_trouble("clock_a:Clock", folder) is None


@pytest.mark.interpreted
def test_a_module_that_takes_too_long(folder, monkeypatch):
    monkeypatch.setattr(unit_class, "IMPORT_TIME", 0.05)
    monkeypatch.setitem(sys.modules, "gate", gate := SimpleNamespace(opens=Event()))
    write(folder, f"import gate\ngate.opens.wait({PATIENCE})\n")
    assert said(folder, "clock_a:Clock") == (
        "clock_a:Clock could not be imported and made within 0.05 s "
        "| let it do later what takes long, in read and write"
    )
    gate.opens.set()
