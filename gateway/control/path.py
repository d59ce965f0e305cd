"""The path of the control socket, for the gateway and for its clients."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

#: The socket of a gateway that runs as a system service.
SYSTEM_SOCKET: Final = Path("/run/modbus-gateway/control.sock")


def control_path(
    config: Path, environment: Mapping[str, str] = os.environ, *, is_root: bool = os.geteuid() == 0
) -> Path:
    """Return the default path of the control socket."""
    if folder := environment.get("RUNTIME_DIRECTORY"):
        return Path(folder.split(":")[0]) / "control.sock"
    if is_root:
        return SYSTEM_SOCKET
    if folder := environment.get("XDG_RUNTIME_DIR"):
        return Path(folder) / "modbus-gateway" / "control.sock"
    return config.absolute().parent / "control.sock"


def folder_of_control(config: Path, socket: str | None) -> Path:
    """Find the folder of the control socket of the gateway with this config, which may say where its `socket` is."""
    return Path(socket or control_path(config)).absolute().parent


@contextmanager
def usual_path_leads(usual: Path, control: Path, environment: Mapping[str, str] = os.environ) -> Iterator[None]:
    """Link a service's usual path to a socket that the config has moved, inside the context: ExecReload= needs it."""
    if usual == control or "RUNTIME_DIRECTORY" not in environment:
        yield
        return
    with suppress(OSError):  # such as another gateway there
        if usual.is_symlink():
            usual.unlink()
        usual.symlink_to(control)
    try:
        yield
    finally:
        with suppress(OSError):
            if usual.readlink() == control:
                usual.unlink()
