"""What is wrong with the files that a config names, and with its own: what `check` says beside what stands in it."""

import os
import stat
from collections.abc import Callable, Iterator
from dataclasses import replace
from errno import EACCES
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from gateway.config.load import Loaded
from gateway.config.machine.file_trouble import SERVICE_CONFIG, file_trouble
from gateway.config.problem import Path as ProblemPath
from gateway.config.problem import Problem, warning
from gateway.config.reading.positions import Positions
from gateway.config.schema.config import Config
from gateway.config.schema.fleet import Fleet
from gateway.config.schema.mqtt import Mqtt
from gateway.config.schema.web import Web
from gateway.errors import BrokerError, FleetError, UsersError
from gateway.fleet.credentials import NO_LIBRARY, read_credentials
from gateway.readconfig.certificate_troubles import certificate_troubles
from gateway.readconfig.libraries import Extra, missing_library, not_installed
from gateway.readconfig.page_users import Users, read_users
from gateway.readconfig.password import read_password, read_secret, read_token
from gateway.tls.settings import SecretFile

#: Rights that others than the owner and the group have, and writing by the group.
_EXPOSED: Final = stat.S_IRWXO | stat.S_IWGRP
#: What is lost without a file.
NO_PAGE: Final = "there will be no web page"
UNPUBLISHED: Final = "nothing will be published"
UNREACHED: Final = "other sites cannot be reached"


def with_file_troubles(loaded: Loaded, file: str, folder: Path = SERVICE_CONFIG) -> Loaded:
    """The same with what is wrong with files; `folder` is that of the service's config."""
    config = loaded.config
    if config is None:
        return loaded
    trouble = file_trouble(file, folder)
    found = [] if trouble is None else [trouble]
    found += certificate_troubles(config, file)
    positions = Positions(loaded.text)
    found += [each.located(file, *positions.key(each.path)) for each in _about_libraries(config)]
    found += [each.located(file, *positions.value(each.path)) for each in _about_files(config, folder)]
    return replace(loaded, problems=(*found, *loaded.problems)) if found else loaded


def _about_files(config: Config, folder: Path) -> Iterator[Problem]:
    """Warnings about what single keys name. Those of TLS are in certificate_troubles, ports in config.port_trouble."""
    web, mqtt, fleet, control = config.web, config.mqtt, config.fleet, config.control
    if mqtt is not None and mqtt.password is not None:
        yield from _about_secret((*mqtt.path, "password"), mqtt.password, read_password, UNPUBLISHED, folder)
    if fleet is not None and fleet.password is not None:
        yield from _about_secret((*fleet.path, "password"), fleet.password, read_password, UNREACHED, folder)
    if fleet is not None and fleet.credentials is not None:
        yield from _about_secret((*fleet.path, "credentials"), fleet.credentials, _read_credentials, UNREACHED, folder)
    if web is not None and web.users is not None:
        yield from _about_users(web, web.users, folder)
    if web is not None and web.token is not None:
        yield from _about_token((*web.path, "token"), web.token, folder)
    if control is not None and control.socket is not None:
        yield from _about_socket((*control.path, "socket"), Path(control.socket))


def _about_libraries(config: Config) -> Iterator[Problem]:
    """Warnings about tables without effect, because a library is missing."""
    tables: tuple[tuple[Extra, Web | Mqtt | Fleet | None], ...] = (
        ("web", config.web),
        ("mqtt", config.mqtt),
        ("fleet", config.fleet),
    )
    for extra, table in tables:
        module = None if table is None else missing_library(extra)
        if table is not None and module is not None:
            yield warning(table.path, f"has no effect: {not_installed(module, extra)}")


def _about_secret(
    path: ProblemPath, secret: SecretFile, read: Callable[[SecretFile], object], loss: str, folder: Path
) -> Iterator[Problem]:
    """Warnings about what the gateway logs in with, and the `loss` without it. Only the service has credentials."""
    if secret.is_credential and "CREDENTIALS_DIRECTORY" not in os.environ:
        return
    try:
        read(secret)
    except (BrokerError, FleetError) as error:
        yield _unreadable(path, secret.name, loss, str(error), error.__cause__)
    else:
        if not secret.is_credential:
            yield from _about_access(path, secret.name, folder)


def _read_credentials(secret: SecretFile) -> None:
    """See that they can be used.

    Raises:
        FleetError: the file cannot be read, or is of no use.
    """
    text = read_secret(secret, FleetError)
    try:
        read_credentials(text)
    except FleetError as error:
        raise FleetError(f"{secret.name}: {error}") from None
    if find_spec("nacl") is None:
        raise FleetError(NO_LIBRARY)


def _unreadable(path: ProblemPath, file: str, loss: str, reason: str, cause: BaseException | None) -> Problem:
    """The warning about a file that cannot be read: perhaps only by who looks at it."""
    if isinstance(cause, PermissionError) and cause.strerror == os.strerror(EACCES):
        return warning(path, f"{file} cannot be read by the user who runs this command", "run it as root")
    return warning(path, f"{loss}: {reason}")


def _about_users(web: Web, name: str, folder: Path) -> Iterator[Problem]:
    """Warnings about the file with the users: the gateway runs without its page if it cannot be used."""
    path, key, file = (*web.path, "users"), Path(name), name
    try:
        if key.stat().st_mode & _EXPOSED:
            remedy = f"chmod o=,g-w {file}; the service must be able to read it: chgrp dialout, 640"
            yield warning(path, f"others may read or change {file}: it is not used", remedy)
            return
        users = read_users(key)
    except FileNotFoundError:
        add = f"modbus-gateway user add NAME --role operator --file {file}"
        yield warning(path, f"there is no file {file}: {NO_PAGE}", add)
    except PermissionError:
        yield warning(path, f"{file} cannot be read by the user who runs this command", "run it as root")
    except OSError as error:
        yield warning(path, f"{file} cannot be read: {error.strerror}")
    except UsersError as error:
        yield warning(path, f"{error}: {NO_PAGE}")
    else:
        yield from _about_access(path, file, folder)
        yield from _about_roles(web, path, file, users)


def _about_token(path: ProblemPath, name: str, folder: Path) -> Iterator[Problem]:
    """Warnings about the file with the token: the gateway runs without its page if it cannot be used."""
    try:
        read_token(name)
    except OSError as error:
        yield _unreadable(path, name, NO_PAGE, f"{name}: {error.strerror or error}", error)
    else:
        yield from _about_access(path, name, folder)


def _about_socket(path: ProblemPath, socket: Path) -> Iterator[Problem]:
    """Warnings about the control socket: the gateway runs without it if it cannot be made."""
    try:
        if socket.is_socket():  # of a gateway that runs
            return
        trouble = "a file with this name exists and is not a socket" if socket.exists() else _no_folder(socket)
    except OSError as error:
        trouble = f"{error.strerror}"
    if trouble:
        yield warning(path, f"no command will reach the gateway: {socket}: {trouble}")


def _no_folder(file: Path) -> str:
    """Why the folder of a file cannot be made, or the file not made there; empty if both can."""
    there = next(each for each in file.absolute().parents if each.exists())
    if not there.is_dir():
        return f"{there} is not a folder"
    may_write = os.access(there, os.W_OK | os.X_OK, effective_ids=True)
    return "" if may_write else f"the user who runs this command cannot create files in {there}"


def _about_access(path: ProblemPath, file: str, folder: Path) -> Iterator[Problem]:
    """The service has a user of its own, which reads what root owns only through a group."""
    status = Path(file).stat()
    is_of_no_group = status.st_gid == 0 or not status.st_mode & stat.S_IRGRP
    if Path(file).parent == folder and status.st_uid == 0 and is_of_no_group:
        what = f"only root may read {file}: the service cannot use it"
        yield warning(path, what, f"sudo chgrp dialout {file}; sudo chmod 640 {file}")


def _about_roles(web: Web, path: ProblemPath, file: str, users: Users) -> Iterator[Problem]:
    if not users:
        add = f"modbus-gateway user add NAME --role operator --file {file}"
        yield warning(path, f"{file} has no users: nobody can log in", add)
    elif web.write and not any(user.role == "operator" for user in users.values()):
        what = f"{file} has no operator: nobody can write, although write = true"
        yield warning(path, what, f"modbus-gateway user add NAME --role operator --file {file}")
