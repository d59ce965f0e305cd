"""What is wrong with the files that a config names, and with its own: what `check` says beside what stands in it."""

import stat
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from gateway.config.file_trouble import SERVICE_CONFIG, file_trouble
from gateway.config.load import Loaded
from gateway.config.positions import Positions
from gateway.config.problem import Problem, warning
from gateway.config.schema import Web
from gateway.errors import UsersError
from gateway.service.certificate_troubles import certificate_troubles
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
    if config.web is not None and config.web.users is not None:
        place = Positions(loaded.text).value((*config.web.path, "users"))
        found += [each.located(file, *place) for each in _about_users(config.web, config.web.users, folder)]
    return replace(loaded, problems=(*found, *loaded.problems)) if found else loaded


def _about_users(web: Web, name: str, folder: Path) -> Iterator[Problem]:
    """Warnings about the file with the users: the gateway runs without its page if it cannot be used."""
    path, key, file = (*web.path, "users"), Path(name), name
    try:
        status = key.stat()
        if status.st_mode & _EXPOSED:
            yield warning(path, f"others may read or change {file}: it is not used", f"chmod 600 {file}")
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
