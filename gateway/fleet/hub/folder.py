"""The folder `hub`: a credentials file for each site, and the configs of the servers. What exists stays as it is."""

import os
import secrets
import stat
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.config.schema.hub import Hub
from gateway.errors import FleetError
from gateway.fleet.credentials import make_credentials, public_key, read_credentials
from gateway.fleet.hub.config import hub_config, sites_of
from gateway.fleet.hub.known import Login, logins_in
from gateway.fleet.hub.leaf import leaf_config

FOLDER: Final = "hub"
CONFIG: Final = "hub.conf"
CREDENTIALS: Final = ".creds"
LEAF_CONFIG: Final = ".leaf.conf"


@dataclass(frozen=True, slots=True)
class Written:
    """What is in the folder now: the sites with a new credentials file, those that are out, and what is left of these.

    `away` are sites whose credentials file is no longer here.
    """

    folder: Path
    new: tuple[str, ...]
    kept: tuple[str, ...]
    away: tuple[str, ...]
    removed: tuple[str, ...]
    useless: tuple[str, ...]


def write_folder(file: Path, hub: Hub, renew: str | None = None) -> Written:
    """Write the folder beside `file`, the list of sites.

    The site `renew` gets a new key, or that of its credentials file if the config has another one.

    Raises:
        FleetError: a file there is not what it must be, or the signing library is not installed.
        OSError: a file cannot be read or written.
    """
    folder = file.parent / FOLDER
    folder.mkdir(mode=0o700, exist_ok=True)
    _check_owner(folder)
    earlier = _earlier(folder / CONFIG)
    if renew is not None and (there := _login(folder, renew, None)) is not None:
        known = earlier.get(renew)
        if known is None or there.key == known.key:
            raise FleetError(f"{_credentials(folder, renew)} exists: remove it first, or move it away")
    kept = {site: login for site, login in earlier.items() if site != renew}
    logins = {site: _login(folder, site, kept.get(site)) for site in sites_of(hub)}
    new = tuple(site for site, login in logins.items() if login is None)
    made = {site: login or Login(_make(_credentials(folder, site), site)) for site, login in logins.items()}
    made |= _with_passwords(hub, made)
    for site in hub.leaf_nodes:
        _replace(folder / f"{site}{LEAF_CONFIG}", leaf_config(hub, site, made[site]))
    _replace(folder / CONFIG, hub_config(hub, made, file.name))
    return Written(
        folder,
        new=new,
        kept=tuple(site for site in made if site not in new),
        away=tuple(site for site in made if not _credentials(folder, site).exists()),
        removed=tuple(sorted(set(earlier) - set(made))),
        useless=_useless(folder, hub),
    )


def _check_owner(folder: Path) -> None:
    """Refuse a folder in which others can put keys of their own in place of those of sites."""
    found = folder.stat()
    if found.st_uid not in (0, os.geteuid()) or found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise FleetError(f"others can change files in {folder}: it must be yours, and only you may write there")


def _credentials(folder: Path, site: str) -> Path:
    return folder / f"{site}{CREDENTIALS}"


def _earlier(config: Path) -> Mapping[str, Login]:
    """Read the logins of the config that is there, if it is one of ours."""
    if not config.exists():
        return {}
    text = config.read_text(encoding="utf-8")
    if "modbus-gateway fleet hub" not in text.partition("\n\n")[0]:
        raise FleetError(f"{config} was not written by this command: move it away first")
    return logins_in(text)


def _login(folder: Path, site: str, known: Login | None) -> Login | None:
    """Find the login of a site: that of the config, or of the credentials file if the config has none."""
    file = _credentials(folder, site)
    if not file.exists():
        return known
    try:
        key = public_key(read_credentials(file.read_text(encoding="utf-8")).key)
    except (FleetError, UnicodeDecodeError) as error:
        raise FleetError(f"{file}: {error}") from error
    if known is not None and known.key != key:
        what = f"{file} has another key than {CONFIG}"
        raise FleetError(
            f"{what}: move it away if the site uses the one in {CONFIG}, or else run this with --renew {site}"
        )
    return known or Login(key)


def _make(file: Path, site: str) -> str:
    """Write a credentials file with a new key; returns the public key."""
    text = make_credentials(site)
    public = public_key(read_credentials(text).key)
    temporary = _written(file.parent, text)
    try:
        os.link(temporary, file)  # unlike a replacement it fails if somebody has made the file meanwhile
    finally:
        temporary.unlink()
    return public


def _with_passwords(hub: Hub, logins: Mapping[str, Login]) -> dict[str, Login]:
    """Give each site with a leaf node a password, unless it has one, and take it from all others."""
    made = {site: Login(login.key) for site, login in logins.items()}
    for site in hub.leaf_nodes:
        made[site] = logins[site]._replace(password=logins[site].password or secrets.token_urlsafe(32))
    return made


def _useless(folder: Path, hub: Hub) -> tuple[str, ...]:
    """Find files of sites that are out, or have no leaf node any more."""
    needed = {f"{site}{CREDENTIALS}" for site in sites_of(hub)} | {f"{site}{LEAF_CONFIG}" for site in hub.leaf_nodes}
    ours = (file.name for file in folder.iterdir() if file.name.endswith((CREDENTIALS, LEAF_CONFIG)))
    return tuple(sorted(set(ours) - needed))


def _replace(file: Path, text: str) -> None:
    _written(file.parent, text).replace(file)


def _written(folder: Path, text: str) -> Path:
    """Write a new file that only its owner can read, to the disk; returns it."""
    descriptor, name = tempfile.mkstemp(prefix=".new-", dir=folder)
    with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
        stream.write(text)
        stream.flush()
        os.fsync(descriptor)
    return Path(name)
