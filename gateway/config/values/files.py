"""Paths of files, and the names of credentials.

A path counts from the folder of the config that names it. That folder is what values are validated with, as `context`.
"""

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gateway.config.problem import WrongValue
from gateway.tls.settings import SecretFile

if TYPE_CHECKING:
    from pydantic import ValidationInfo  # commands that read no config use other functions of this module

#: A file in the folder of systemd's credentials, and nowhere else.
_CREDENTIAL = re.compile(r"(?!\.)[A-Za-z0-9._-]{1,64}")


def check_path(value: str) -> str:
    """Return a path that the system takes, and a log can show."""
    if not value.isprintable():
        raise WrongValue("has characters that cannot be seen")
    return value


def parse_include(value: object) -> tuple[str, ...]:
    """Parse the list of files that a config includes."""
    if not isinstance(value, list) or not all(isinstance(each, str) and each.strip("/") for each in value):
        raise WrongValue("must be a list of files", 'write ["conf.d/*.toml"]')
    return tuple(check_path(each) for each in value)


def in_folder(path: str, info: "ValidationInfo") -> str:
    """Take a path from the folder of the config."""
    return str((info.context or Path()) / path)


def secret_in_folder(file: SecretFile, info: "ValidationInfo") -> SecretFile:
    """Take a file from the folder of the config; leave a credential as it is."""
    return file if file.is_credential else replace(file, name=in_folder(file.name, info))


def parse_token_file(value: object) -> str:
    """Parse the name of the file that holds a token."""
    match value:
        case {"file": str(path), **others} if path and not others:
            return check_path(path)
    raise WrongValue("names no file", 'write { file = "/etc/modbus-gateway/metrics.token" }')


def parse_file(value: object) -> SecretFile:
    """Parse a path, or the name of a credential that systemd hands to the service."""
    match value:
        case str(path) if path:
            return SecretFile(check_path(path))
        case {"credential": str(name), **others} if _CREDENTIAL.fullmatch(name) and not others:
            return SecretFile(name, is_credential=True)
    raise WrongValue("names no file", 'write "/etc/modbus-gateway/server.key", or { credential = "server.key" }')
