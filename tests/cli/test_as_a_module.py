"""`python -m gateway` is the same program."""

import runpy
import sys

import pytest


def test_the_package_is_the_command(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["gateway", "--version"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_module("gateway", run_name="__main__")
    assert not ended.value.code
    assert capsys.readouterr().out.startswith("modbus-gateway ")
