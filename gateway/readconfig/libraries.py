"""Libraries that only some tables of the config need: they come with an extra of the package, named as the table."""

from collections.abc import Mapping
from importlib.util import find_spec
from typing import Final

from gateway import __version__

_MODULES: Final[Mapping[str, tuple[str, ...]]] = {
    "web": ("aiohttp", "jinja2", "prometheus_client"),
    "mqtt": ("paho",),
    "fleet": ("nats",),
}


def missing_library(extra: str) -> str | None:
    """The first module of an extra that is not there; None if all are."""
    return next((module for module in _MODULES[extra] if find_spec(module) is None), None)


def not_installed(module: str | None, extra: str) -> str:
    """What is said where a module of an extra is missing."""
    wheel = f"./dist/mbgw-{__version__}-py3-none-any.whl[web,mqtt,fleet,yaml]"
    return f"{module} is not installed: the wheel was installed without [{extra}]; pipx install --force '{wheel}'"
