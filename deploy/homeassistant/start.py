"""Starts the gateway as an add-on of Home Assistant: makes the first config, and gets the password of the broker."""

import json
import os
import shutil
from pathlib import Path
from urllib.error import URLError
from urllib.request import Request, urlopen

CONFIG = Path("/config/gateway.toml")
EXAMPLE = Path(__file__).parent / "gateway.toml"
PASSWORD = Path("/data/mqtt.password")
SERVICE = "http://supervisor/services/mqtt"


def main() -> None:
    """Prepare both files, then become the gateway."""
    if not CONFIG.exists():
        shutil.copy(EXAMPLE, CONFIG)
        print(f"A first config is in {CONFIG}: describe your lines and devices there, then restart the add-on.")
    save_password()
    os.execvp("modbus-gateway", ["modbus-gateway", "run", str(CONFIG)])  # noqa: S606 - it takes our place


def save_password() -> None:
    """Write the password of the broker to a file, if Home Assistant has a broker."""
    request = Request(SERVICE, headers={"Authorization": f"Bearer {os.environ.get('SUPERVISOR_TOKEN', '')}"})
    try:
        with urlopen(request, timeout=10) as response:  # noqa: S310 - always http
            broker = json.load(response)["data"]
        address = f"The broker is mqtt{'s' if broker.get('ssl') else ''}://{broker['host']}:{broker['port']}"
        user, password = broker.get("username"), broker.get("password")
    except (URLError, OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        print(f"Home Assistant names no broker ({error}): with [mqtt], set broker, user and password yourself.")
        return
    print(f"{address}, the user {user}." if user else f"{address}, without a user.")
    if not password:
        PASSWORD.unlink(missing_ok=True)
        return
    PASSWORD.touch(mode=0o600)
    PASSWORD.write_text(password, encoding="utf-8")


if __name__ == "__main__":
    main()
