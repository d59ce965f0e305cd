"""Libraries that only some tables of the config need. Each table has an extra of the package with its name."""

import json
import sys
from collections.abc import Mapping
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Final

_MODULES: Final[Mapping[str, tuple[str, ...]]] = {
    "web": ("aiohttp", "jinja2", "prometheus_client"),
    "mqtt": ("paho",),
    "fleet": ("nats",),
}
#: Who makes environments of his own, by a folder in their paths.
_TOOLS: Final[Mapping[str, str]] = {"pipx": "pipx install --force", "uv": "uv tool install --force"}


def missing_library(extra: str) -> str | None:
    """Return the first module of an extra that is not installed; None if all are."""
    return next((module for module in _MODULES[extra] if find_spec(module) is None), None)


def not_installed(module: str | None, extra: str) -> str:
    """Say that a module of an extra is missing, and how to install it."""
    what = f"{module} is not installed"
    folder = Path(sys.prefix)  # of pipx or uv, or of the program that the gateway is a part of
    metadata = import_module("importlib.metadata")  # loaded only when something is missing
    try:
        origin = metadata.distribution("mbgw").read_text("direct_url.json")
    except metadata.PackageNotFoundError:  # a Debian package or a checkout, which have all extras
        is_package = folder == Path("/usr")
        return f"{what}; {'sudo apt install --reinstall modbus-gateway' if is_package else 'uv sync --all-extras'}"
    command = next((each for tool, each in _TOOLS.items() if tool in folder.parts), f"{folder}/bin/pip install")
    place = f" @ {json.loads(origin)['url']}" if origin else ""  # a file, which may not be in any index
    return f'{what}: mbgw was installed without [{extra}]; {command} "mbgw[web,mqtt,fleet,yaml]{place}"'
