"""Keys and tokens of NATS, as `nsc` makes them: an operator, an account, and users by the template of a signing key."""

import base64
import json
import time
from collections.abc import Iterable
from typing import Any, Final

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

_OPERATOR, _ACCOUNT, _USER, _SEED = 14 << 3, 0, 20 << 3, 18 << 3
_NO_LIMITS: Final = {"subs": -1, "data": -1, "payload": -1}
_NO_ACCOUNT_LIMITS: Final = {**_NO_LIMITS, "imports": -1, "exports": -1, "wildcards": True, "conn": -1, "leaf": -1}
_WITH_JETSTREAM: Final = {"mem_storage": -1, "disk_storage": -1, "streams": -1, "consumer": -1}


class Key:
    """A pair of keys of this kind."""

    def __init__(self, kind: int) -> None:
        self._kind = kind
        self._private = Ed25519PrivateKey.generate()
        self.name = _text(bytes((kind,)) + self._private.public_key().public_bytes_raw())

    @property
    def seed(self) -> str:
        """The private key, as a credentials file has it."""
        return _text(bytes((_SEED | self._kind >> 5, (self._kind & 31) << 3)) + self._private.private_bytes_raw())

    def issue(self, subject: str, name: str, claims: dict[str, Any]) -> str:
        """A token of this key."""
        whole = {"jti": name, "iat": int(time.time()), "iss": self.name, "sub": subject, "name": name}
        parts = {"typ": "JWT", "alg": "ed25519-nkey"}, {**whole, "nats": {"version": 2, **claims}}
        text = ".".join(_url(json.dumps(part).encode()) for part in parts)
        return f"{text}.{_url(self.sign(text.encode()))}"

    def sign(self, data: bytes) -> bytes:
        """Its signature."""
        return self._private.sign(data)


class Operator:
    """One with the account FLEET, whose users may publish and hear what a template says; `{{name()}}` is their name."""

    def __init__(self, publish: Iterable[str], subscribe: Iterable[str]) -> None:
        operator, self._account, self._signer = Key(_OPERATOR), Key(_ACCOUNT), Key(_ACCOUNT)
        permissions = {"pub": {"allow": [*publish]}, "sub": {"allow": [*subscribe]}, **_NO_LIMITS}
        signer = {"kind": "user_scope", "key": self._signer.name, "role": "site", "template": permissions}
        claims = {"type": "account", "limits": _NO_ACCOUNT_LIMITS | _WITH_JETSTREAM, "signing_keys": [signer]}
        token = operator.issue(self._account.name, "FLEET", claims)
        own = operator.issue(operator.name, "fleet", {"type": "operator"})
        #: What a server's config has of it.
        system = Key(_ACCOUNT).name
        system_token = operator.issue(system, "SYS", {"type": "account", "limits": _NO_ACCOUNT_LIMITS})
        accounts = f"{self._account.name}: {token}, {system}: {system_token}"
        self.settings = (
            f"operator: {own}\nsystem_account: {system}\nresolver: MEMORY\nresolver_preload: {{ {accounts} }}"
        )

    def user(self, site: str) -> tuple[str, Key]:
        """The token and the key of a site."""
        user = Key(_USER)
        return self._signer.issue(user.name, site, {"type": "user", "issuer_account": self._account.name}), user

    def credentials(self, site: str) -> str:
        """Both as a credentials file."""
        token, user = self.user(site)
        return "".join(
            f"-----BEGIN {what}-----\n{text}\n------END {what}------\n\n"
            for what, text in (("NATS USER JWT", token), ("USER NKEY SEED", user.seed))
        )


def _text(data: bytes) -> str:
    return base64.b32encode(data + _check_sum(data).to_bytes(2, "little")).decode().rstrip("=")


def _check_sum(data: bytes) -> int:
    """CRC-16/XMODEM."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = crc << 1 ^ (0x1021 if crc & 0x8000 else 0)
        crc &= 0xFFFF
    return crc


def _url(data: bytes) -> str:
    return base64.urlsafe_b64encode(data).decode().rstrip("=")
