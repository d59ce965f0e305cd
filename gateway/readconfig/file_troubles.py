"""Warnings of `check` about the files that a config names, and about its own file, but not about its content."""

import os
import stat
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from errno import EACCES
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from gateway.config.add_ons import ADD_ONS
from gateway.config.load import Loaded, load_profile
from gateway.config.machine.file_text import SERVICE_CONFIG, file_trouble, folder_of
from gateway.config.machine.profile_folders import BESIDE
from gateway.config.plan.settings import Plan
from gateway.config.problem import Path as ProblemPath
from gateway.config.problem import Problem, warning
from gateway.config.profile_files import ProfileFiles
from gateway.config.reading.positions import Positions
from gateway.config.reading.whole_text import parted
from gateway.config.schema.config import Config
from gateway.config.schema.line import Line
from gateway.config.schema.table import Table
from gateway.config.values.port import VirtualPort
from gateway.errors import BrokerError, FleetError, TlsError, UsersError
from gateway.fleet.credentials import NO_LIBRARY, read_credentials
from gateway.hardware.pseudo_terminals import find_group_to_give, has_group
from gateway.readconfig.libraries import missing_library, not_installed
from gateway.readconfig.page_users import Users, read_users
from gateway.readconfig.password import read_password, read_secret, read_token
from gateway.tls.settings import SecretFile, Secured, ServerTls
from gateway.tls.status import EARLY

#: All rights of others, and the right of the group to write.
_EXPOSED: Final = stat.S_IRWXO | stat.S_IWGRP


def with_file_troubles(loaded: Loaded, file: str, folder: Path = SERVICE_CONFIG) -> Loaded:
    """Add the troubles with files to the problems of `loaded`; `folder` holds the service's config."""
    config = loaded.config
    if config is None:
        return loaded
    _, included = parted(loaded.text)
    files = [(file, folder), *((str(Path(file).parent / name), (folder / name).parent) for name in included)]
    found = [trouble for each in files if (trouble := file_trouble(*each)) is not None]
    found += () if loaded.plan is None else certificate_troubles(loaded.plan, file)
    positions = loaded.positions or Positions(loaded.text)
    found += [positions.locate(replace(each, on_key=True), file) for each in _about_libraries(config)]
    about_files = (*_about_files(config, folder), *_about_code(config, Path(file)))
    found += [positions.locate(each, file) for each in about_files]
    found += _about_profiles(config, file, folder)
    return replace(loaded, problems=(*found, *loaded.problems)) if found else loaded


def _about_files(config: Config, folder: Path) -> Iterator[Problem]:
    """Warn of files that keys name. Files of TLS are in certificate_troubles, ports in config.machine."""
    for add_on in ADD_ONS:
        table = add_on.table(config)
        if table is not None:
            for key in filter(table.has, add_on.files):
                yield from _about_file(table, key, add_on.loss, folder)
    if config.control is not None and config.control.socket is not None:
        yield from _about_socket((*config.control.path, "socket"), Path(config.control.socket))
    for line in config.line:
        if isinstance(line.port, VirtualPort):
            yield from _about_virtual_port(line, line.port)
            # The usual folder of the control socket is that of whoever runs the gateway, not of who checks.
            socket = config.control.socket if config.control else None
            yield from _in_the_way(line, Path(socket or "").parent / line.port.name)


def _about_file(table: Table, key: str, loss: str, folder: Path) -> Iterator[Problem]:
    """Warn of the file that a key of an add-on names. `loss` says what happens without it."""
    path, named = (*table.path, key), getattr(table, key)
    match key:
        case "password":
            yield from _about_secret(path, named, read_password, loss, folder)
        case "credentials":
            yield from _about_secret(path, named, _read_credentials, loss, folder)
        case "token":
            yield from _about_token(path, named, loss, folder)
        case "users":
            yield from _about_users(path, named, loss, folder, may_write=getattr(table, "write", False))


def _about_code(config: Config, file: Path) -> Iterator[Problem]:
    """Warn of code of units made in Python that all users may change. Their modules have been imported."""
    for image in config.image:
        module = sys.modules.get((image.python or "").partition(":")[0])
        places = () if module is None else (Path(getattr(module, "__file__", None) or file), folder_of(file))
        exposed = next(filter(_may_be_changed_by_all, places), None)
        if exposed is not None:
            what = f"all users may change {exposed}, and with it what the gateway does"
            yield warning((*image.path, "python"), what, f"chmod o-w {exposed}")


def _may_be_changed_by_all(path: Path) -> bool:
    try:
        return bool(path.stat().st_mode & stat.S_IWOTH)
    except OSError:  # a module in a zip file
        return False


def _about_profiles(config: Config, file: str, folder: Path) -> Iterator[Problem]:
    """Warn of profiles in files that are broken and not used, and of those in use that the service cannot read."""
    files = ProfileFiles.of_config(file, folder / BESIDE)
    for name in files.own_names():
        path = files.places(name)[0]
        if name in config.profile:
            trouble = file_trouble(path, folder / BESIDE)
            yield from () if trouble is None else (trouble,)
        else:
            for each in load_profile(Path(path), name).problems:
                if each.severity == "error":
                    yield replace(each, severity="warning", what=f"{each.what} (no device has this profile)")


def _about_libraries(config: Config) -> Iterator[Problem]:
    """Warn of tables without effect, because a library is missing."""
    for add_on in ADD_ONS:
        table = add_on.table(config)
        module = None if table is None else missing_library(add_on.key)
        if table is not None and module is not None:
            yield warning(table.path, f"has no effect: {not_installed(module, add_on.key)}")


def _about_secret(
    path: ProblemPath, secret: SecretFile, read: Callable[[SecretFile], object], loss: str, folder: Path
) -> Iterator[Problem]:
    """Warn of a file that the gateway logs in with, and of the `loss` without it. Only the service has credentials."""
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
    """Check that credentials can be used.

    Raises:
        FleetError: the file cannot be read, its content is not valid, or PyNaCl is missing.
    """
    text = read_secret(secret, FleetError)
    try:
        read_credentials(text)
    except FleetError as error:
        raise FleetError(f"{secret.name}: {error}") from None
    if find_spec("nacl") is None:
        raise FleetError(NO_LIBRARY)


def _unreadable(path: ProblemPath, file: str, loss: str, reason: str, cause: BaseException | None) -> Problem:
    """Make the warning about a file that cannot be read, perhaps only by the user who runs this command."""
    if isinstance(cause, PermissionError) and cause.strerror == os.strerror(EACCES):
        return warning(path, f"{file} cannot be read by the user who runs this command", "run it as root")
    return warning(path, f"{loss}: {reason}")


def _about_users(path: ProblemPath, file: str, loss: str, folder: Path, *, may_write: bool) -> Iterator[Problem]:
    """Warn of the file with the users. With `may_write`, it should have an operator."""
    try:
        if Path(file).stat().st_mode & _EXPOSED:
            remedy = f"chmod o=,g-w {file}; the service must be able to read it: chgrp dialout, 640"
            yield warning(path, f"others may read or change {file}: it is not used", remedy)
            return
        users = read_users(Path(file))
    except FileNotFoundError:
        add = f"modbus-gateway user add NAME --role operator --file {file}"
        yield warning(path, f"there is no file {file}: {loss}", add)
    except PermissionError:
        yield warning(path, f"{file} cannot be read by the user who runs this command", "run it as root")
    except OSError as error:
        yield warning(path, f"{file} cannot be read: {error.strerror}")
    except UsersError as error:
        yield warning(path, f"{error}: {loss}")
    else:
        yield from _about_access(path, file, folder)
        yield from _about_roles(path, file, users, may_write=may_write)


def _about_token(path: ProblemPath, name: str, loss: str, folder: Path) -> Iterator[Problem]:
    """Warn of the file with the token."""
    try:
        read_token(name)
    except OSError as error:
        yield _unreadable(path, name, loss, f"{name}: {error.strerror or error}", error)
    else:
        yield from _about_access(path, name, folder)


def _about_socket(path: ProblemPath, socket: Path) -> Iterator[Problem]:
    """Warn of a control socket that cannot be made: the gateway runs without it."""
    try:
        if socket.is_socket():  # of a gateway that runs
            return
        trouble = "a file with this name exists and is not a socket" if socket.exists() else _no_folder(socket)
    except OSError as error:
        trouble = f"{error.strerror}"
    if trouble:
        yield warning(path, f"no command will reach the gateway: {socket}: {trouble}")


def _about_virtual_port(line: Line, port: VirtualPort) -> Iterator[Problem]:
    """Warn of a link that cannot be made, and of a group that cannot get its port."""
    if port.name.startswith("/"):
        trouble = f"there is no folder {Path(port.name).parent}"
        if Path(port.name).parent.is_dir():
            trouble = _no_folder(Path(port.name))
        if trouble:
            yield warning((*line.path, "port"), trouble, "the service needs ReadWritePaths= for a folder of its own")
    if find_group_to_give(line.group) is None:
        where = (*line.path, "group" if line.has("group") else "port")
        if has_group(line.group):
            what = f'the user who runs this command cannot give the port to the group "{line.group}"'
            remedy = "if the service cannot either, programs need its own group: SupplementaryGroups= in its unit"
        else:
            what = f'there is no group "{line.group}" on this machine'
            remedy = "programs need the service's own group, or root, until there is: groupadd"
        yield warning(where, what, remedy)


def _in_the_way(line: Line, link: Path) -> Iterator[Problem]:
    """Warn of what is there already at the place of a link, and stays; a name without a folder is not looked for."""
    if link.is_absolute() and os.path.lexists(link) and not link.is_symlink():
        what = f"{link} is there already and is not a virtual port"
        yield warning((*line.path, "port"), what, "the line stays down until it is moved, or the port has another name")


def _no_folder(file: Path) -> str:
    """Say why `file` or its folder cannot be made; empty if both can."""
    there = next(each for each in file.absolute().parents if each.exists())
    if not there.is_dir():
        return f"{there} is not a folder"
    may_write = os.access(there, os.W_OK | os.X_OK, effective_ids=True)
    return "" if may_write else f"the user who runs this command cannot create files in {there}"


def _about_access(path: ProblemPath, file: str, folder: Path) -> Iterator[Problem]:
    """Warn of a file of root that the service cannot read: its own user needs the rights of a group."""
    status = Path(file).stat()
    is_of_no_group = status.st_gid == 0 or not status.st_mode & stat.S_IRGRP
    if Path(file).parent == folder and status.st_uid == 0 and is_of_no_group:
        what = f"only root may read {file}: the service cannot use it"
        yield warning(path, what, f"sudo chgrp dialout {file}; sudo chmod 640 {file}")


def _about_roles(path: ProblemPath, file: str, users: Users, *, may_write: bool) -> Iterator[Problem]:
    if not users:
        add = f"modbus-gateway user add NAME --role operator --file {file}"
        yield warning(path, f"{file} has no users: nobody can log in", add)
    elif may_write and not any(user.role == "operator" for user in users.values()):
        what = f"{file} has no operator: nobody can write, although write = true"
        yield warning(path, what, f"modbus-gateway user add NAME --role operator --file {file}")


def certificate_troubles(plan: Plan, file: str) -> Iterator[Problem]:
    """Yield a warning for each file that cannot be used, or not for long. Only the service can see credentials."""
    besides = (one for part in plan.add_ons.values() for one in part.secured)
    for one in (*plan.secured, *besides):
        if not _has_credentials(one) or "CREDENTIALS_DIRECTORY" in os.environ:
            place, _, line = one.source.rpartition(":")
            named = file if place in ("", Path(file).name) else str(Path(file).parent / place)
            yield from (each.located(named, int(line or 0), 1) for each in _look_at(one))


def _look_at(one: Secured) -> Iterator[Problem]:
    from gateway.readconfig.expiry import DAY  # noqa: PLC0415 - few configs name such files
    from gateway.tls.contexts import load  # noqa: PLC0415 - loads ssl

    try:
        loaded = load(one.settings)
    except TlsError as error:
        yield warning((), f"{one.name} cannot be used: {error}")
        return
    for said in loaded.warnings:
        yield warning((), f"{one.name}: {said}")
    for expiry in loaded.expiries:
        left = (expiry.at - time.time()) / DAY
        if left < EARLY:
            what = f"{expiry.file} has expired" if left < 0 else f"{expiry.file} expires in {left:.0f} days"
            yield warning((), f"{one.name}: {what}", "put another one in its place, then modbus-gateway reload")


def _has_credentials(one: Secured) -> bool:
    own = one.settings
    others = (own.clients_ca, own.crl) if isinstance(own, ServerTls) else (own.ca,)
    return any(file is not None and file.is_credential for file in (own.certificate, own.key, *others))
