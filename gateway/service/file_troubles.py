"""What is wrong with the files that a config names, and with its own: what `check` says beside what stands in it."""

import os
import stat
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from errno import EACCES
from pathlib import Path

from gateway.config.file_trouble import SERVICE_CONFIG, file_trouble
from gateway.config.load import Loaded
from gateway.config.positions import Positions
from gateway.config.problem import Problem, warning
from gateway.config.schema import Config, Fleet, Mqtt, Web
from gateway.errors import BrokerError, UsersError
from gateway.service.certificate_troubles import certificate_troubles
from gateway.service.libraries import Extra, missing_library, not_installed
from gateway.service.password import read_password
from gateway.tls.secret_file import SecretFile
from gateway.web.users import Users, read_users

#: Rights that others than the owner and the group have, and writing by the group.
_EXPOSED = stat.S_IRWXO | stat.S_IWGRP


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
    mqtt = config.mqtt
    if mqtt is not None and mqtt.password is not None:
        place = positions.value((*mqtt.path, "password"))
        found += [each.located(file, *place) for each in _about_password(mqtt, mqtt.password, folder)]
    if config.web is not None and config.web.users is not None:
        place = positions.value((*config.web.path, "users"))
        found += [each.located(file, *place) for each in _about_users(config.web, config.web.users, folder)]
    if config.web is not None and config.web.token is not None:
        place = positions.value((*config.web.path, "token"))
        found += [each.located(file, *place) for each in _about_token(config.web, config.web.token, folder)]
    return replace(loaded, problems=(*found, *loaded.problems)) if found else loaded


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


def _about_password(mqtt: Mqtt, secret: SecretFile, folder: Path) -> Iterator[Problem]:
    """Warnings about the password for the broker: without it nothing is published. Only the service has credentials."""
    path = (*mqtt.path, "password")
    if secret.is_credential:
        return
    try:
        read_password(secret)
        status = Path(secret.name).stat()
    except BrokerError as error:
        cause = error.__cause__
        if isinstance(cause, PermissionError) and cause.strerror == os.strerror(EACCES):
            yield warning(path, f"{secret.name} cannot be read by who runs this command", "run it as root")
        else:
            yield warning(path, f"nothing will be published: {error}")
    else:
        yield from _about_access(path, secret.name, status.st_uid, status.st_gid, status.st_mode, folder)


def _about_users(web: Web, name: str, folder: Path) -> Iterator[Problem]:
    """Warnings about the file with the users: the gateway runs without its page if it cannot be used."""
    path, key, file = (*web.path, "users"), Path(name), name
    try:
        status = key.stat()
        if status.st_mode & _EXPOSED:
            remedy = f"chmod o=,g-w {file}; the service must be able to read it: chgrp dialout, 640"
            yield warning(path, f"others may read or change {file}: it is not used", remedy)
            return
        users = read_users(key)
    except FileNotFoundError:
        add = f"modbus-gateway user add NAME --role operator --file {file}"
        yield warning(path, f"there is no file {file}: there will be no web page", add)
    except PermissionError:
        yield warning(path, f"{file} cannot be read by who runs this command", "run it as root")
    except OSError as error:
        yield warning(path, f"{file} cannot be read: {error.strerror}")
    except UsersError as error:
        yield warning(path, f"{error}: there will be no web page")
    else:
        yield from _about_access(path, file, status.st_uid, status.st_gid, status.st_mode, folder)
        yield from _about_roles(web, path, file, users)


def _about_token(web: Web, name: str, folder: Path) -> Iterator[Problem]:
    """Warnings about who may read the file with the token: the gateway runs without its page if others may."""
    path = (*web.path, "token")
    with suppress(FileNotFoundError, PermissionError):  # a file that is made later, or for the service only
        status = Path(name).stat()
        if status.st_mode & _EXPOSED:
            what = f"others may read or change {name}: there will be no web page"
            yield warning(path, what, f"chmod o=,g-w {name}")
        else:
            yield from _about_access(path, name, status.st_uid, status.st_gid, status.st_mode, folder)


def _about_access(
    path: tuple[str | int, ...], file: str, uid: int, gid: int, mode: int, folder: Path
) -> Iterator[Problem]:
    """The service has a user of its own, which reads what root owns only through a group."""
    if Path(file).parent == folder and uid == 0 and (gid == 0 or not mode & stat.S_IRGRP):
        what = f"only root may read {file}: the service cannot use it"
        yield warning(path, what, f"sudo chgrp dialout {file}; sudo chmod 640 {file}")


def _about_roles(web: Web, path: tuple[str | int, ...], file: str, users: Users) -> Iterator[Problem]:
    if not users:
        add = f"modbus-gateway user add NAME --role operator --file {file}"
        yield warning(path, f"{file} has no users: nobody can log in", add)
    elif web.write and not any(user.role == "operator" for user in users.values()):
        what = f"{file} has no operator: nobody can write, although write = true"
        yield warning(path, what, f"modbus-gateway user add NAME --role operator --file {file}")
