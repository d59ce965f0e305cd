"""Libraries that only some tables of the config need. Each table has an extra of the package with its name."""

import sys
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Final

_MODULES: Final[Mapping[str, tuple[str, ...]]] = {
    "web": ("aiohttp", "jinja2", "prometheus_client"),
    "mqtt": ("paho",),
    "fleet": ("nats",),
}


def missing_library(extra: str) -> str | None:
    """Return the first module of an extra that is not installed; None if all are."""
    return next((module for module in _MODULES[extra] if find_spec(module) is None), None)


def not_installed(module: str | None, extra: str) -> str:
    """Say that a module of an extra is missing, and how to install it."""
    environment = Path(sys.prefix)  # of pipx, or of the program that the gateway is a part of
    command = "pipx install --force" if "pipx" in environment.parts else f"{environment / 'bin' / 'pip'} install"
    what = f"{module} is not installed: mbgw was installed without [{extra}]"
    return f'{what}; {command} "WHEEL[web,mqtt,fleet,yaml]", with its wheel as WHEEL'
