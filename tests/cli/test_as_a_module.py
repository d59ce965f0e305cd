"""`python -m gateway` is the same program."""

import runpy
import sys
from collections.abc import Callable

import pytest

from gateway.cli.main import main


@pytest.mark.parametrize("words", [["--version"], [], ["check", "/nonexistent.toml"], ["chekc"]], ids=" ".join)
def test_the_package_is_the_command(words: list[str], monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["modbus-gateway", *words])
    as_command = _ended(lambda: sys.exit(main())), *capsys.readouterr()
    monkeypatch.setattr(sys, "argv", ["/somewhere/gateway/__main__.py", *words])
    as_module = _ended(lambda: runpy.run_module("gateway", run_name="__main__")), *capsys.readouterr()
    assert as_module == as_command
    assert as_command[1] or as_command[2]


def _ended(run: Callable[[], object]) -> object:
    with pytest.raises(SystemExit) as ended:
        run()
    return ended.value.code
