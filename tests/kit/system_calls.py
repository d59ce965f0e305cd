"""The ways of `gateway.clock.system_calls`, whichever is installed."""

import os
import shlex
import subprocess
import sys
import sysconfig
from importlib.machinery import ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest

from gateway.clock import system_calls
from kit.left_out import need

_COMPILED = "gateway.clock._system_calls"
_SOURCE = Path(system_calls.__file__).with_name("_system_calls.c")
#: The number of a system call that there will never be.
_NO_CALL = 999_999
_STRICT = ("-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC")


@pytest.fixture(scope="session")
def in_c(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    """The functions in C, compiled now."""
    return _compile(tmp_path_factory.mktemp("in_c"))


@pytest.fixture(scope="session")
def in_c_before_5_11(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    """The same on a kernel without `epoll_pwait2`."""
    return _compile(tmp_path_factory.mktemp("before_5_11"), f"-DEPOLL_PWAIT2={_NO_CALL}")


@pytest.fixture(scope="session")
def in_python() -> ModuleType:
    """The functions in Python."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, _COMPILED, None)  # as if it were not there
        return _load("system_calls_in_python", Path(system_calls.__file__))


@pytest.fixture(params=["in_python", "in_c", "in_c_before_5_11"])
def calls(request: pytest.FixtureRequest) -> ModuleType:
    """The functions in each way."""
    return request.getfixturevalue(request.param)


@pytest.fixture
def waits_with(calls: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have selectors that are made from now on wait in each way."""
    monkeypatch.setattr("gateway.clock.exact_loop.wait_of", calls.wait_of)


def _compile(folder: Path, *more: str) -> ModuleType:
    headers, library = sysconfig.get_path("include"), folder / "_system_calls.so"
    compiler = shlex.split(os.environ.get("CC", "cc"))
    need("cc")
    if not Path(headers, "Python.h").exists():
        pytest.skip("needs the headers of Python")
    subprocess.run([*compiler, *_STRICT, *more, f"-I{headers}", _SOURCE, "-o", library], check=True)
    return _load("_system_calls", library, ExtensionFileLoader("_system_calls", str(library)))


def _load(name: str, path: Path, loader: ExtensionFileLoader | None = None) -> ModuleType:
    spec = spec_from_file_location(name, path, loader=loader)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
