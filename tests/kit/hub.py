"""The hub of a fleet as `fleet hub` makes it, of three sites, and the logins of these."""

from pathlib import Path
from typing import Any, Final

from nats.aio.client import Client

from gateway.config.reading.hub_file import parse_hub_file
from gateway.fleet.credentials import public_key, read_credentials, sign
from gateway.fleet.hub.folder import Written, write_folder

#: Two sites at the hub, and one behind a leaf node; both may ask control too.
SITES: Final = """
control = "control"
sites = ["plant-1", "plant-3"]
asks = { plant-1 = ["control"], plant-3 = ["control"] }
leases = ["control.hall-a", "plant-1.hall-a", "plant-3.hall-a"]
leaf_nodes = ["plant-3"]
address = "hub.plant.example"
"""


def write_hub(folder: Path, text: str = SITES) -> Written:
    """What `fleet hub` writes for the sites in `text`, into `folder`/hub."""
    file = folder / "fleet.toml"
    file.write_text(text)
    read = parse_hub_file(text, str(file))
    assert read.hub is not None, read.problems
    return write_folder(file, read.hub)


def key_in(credentials: Path) -> bytes:
    """The private key in a credentials file."""
    return read_credentials(credentials.read_text()).key


async def connect(client: Client, port: int, credentials: Path, **options: Any) -> None:
    """Connect a plain client of NATS with a credentials file."""
    key = key_in(credentials)
    client._public_nkey = public_key(key)
    scheme = "tls" if "tls" in options else "nats"
    await client.connect(
        f"{scheme}://127.0.0.1:{port}", signature_cb=lambda nonce: sign(key, nonce), allow_reconnect=False, **options
    )
