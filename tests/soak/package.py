"""The Debian package in a Debian that is booted for it: it installs, serves, is upgraded, removed and purged.

    .venv/bin/python tests/soak/package.py bookworm
    .venv/bin/python tests/soak/package.py trixie dist/modbus-gateway_0.1.0_amd64.deb

Without a package it builds one first, and needs what deploy/build-deb asks for. One of a release must run compiled
modules there. It needs root, systemd-nspawn and mmdebstrap, and takes a minute or two; status 0 if all went well.
"""

import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from kit.booted import SERVICE, SOCKET, BootedSystem, booted_bare
from kit.system_tree import make, system_tree

BUILD = Path(__file__).resolve().parents[2] / "deploy/build-deb"
CONFIG = "/etc/modbus-gateway/gateway.toml"
STATE = "/var/lib/private/modbus-gateway"
LIBRARIES = "/usr/lib/modbus-gateway"
COMPILED = f"{LIBRARIES}/gateway/__pycache__"
#: The first three holding registers of unit 200, and what the config of a new installation says about them.
READ = bytes.fromhex("0001 0000 0006 C8 03 0000 0003")
ANSWER = bytes.fromhex("0001 0000 0009 C8 03 06 0001 0002 0003")

#: What reads the page of a new installation, with what each Debian has.
READ_PAGE = "import urllib.request; print(urllib.request.urlopen('http://127.0.0.1:8502').read().decode())"


def build() -> Path:
    """Build the package, as a user does."""
    done = subprocess.run([BUILD], stdout=subprocess.PIPE, text=True, check=True)
    return Path(done.stdout.strip())


def newer(package: Path, folder: Path, preinst: str = "") -> Path:
    """The same as a later version, whose config is another one."""
    tree, file = folder / "newer", folder / "newer.deb"
    subprocess.run(["dpkg-deb", "--raw-extract", package, tree], check=True)
    if preinst:
        (tree / "DEBIAN/preinst").write_text(preinst)
        (tree / "DEBIAN/preinst").chmod(0o755)
    control = tree / "DEBIAN/control"
    control.write_text(control.read_text().replace("\nVersion: ", "\nVersion: 1:"))
    with (tree / CONFIG.lstrip("/")).open("a") as config:
        config.write("# There is more to say.\n")
    subprocess.run(["dpkg-deb", "--build", tree, file], check=True, stdout=subprocess.DEVNULL)
    shutil.rmtree(tree)
    return file


def install(system: BootedSystem, package: Path) -> str:
    """Install or upgrade as `apt` does when nobody answers questions; what it needs is there. Says what it prints."""
    shutil.copy(package, system.root / "root/package.deb")
    return system.done("dpkg", "--force-confdef", "--install", "/root/package.deb")


def check_serving(system: BootedSystem) -> None:
    """The service runs, its user has the rights that it needs, and clients get answers."""
    assert system.show("ActiveState") == "active", system.status()
    with system.connect() as client:
        client.sendall(READ)
        assert client.recv(260) == ANSWER, system.status()


def check_installation(system: BootedSystem, package: Path) -> None:
    """Install it where it never was."""
    begin = time.monotonic()
    said = install(system, package)
    assert "1. Open the page: http://127.0.0.1:8502\n" in said, said
    check_serving(system)
    assert "try-me" in system.done("python3", "-c", READ_PAGE)
    for unit in (SERVICE, SOCKET):
        system.done("systemctl", "is-enabled", unit)
    system.done("modbus-gateway", "check")
    assert "try-me" in system.done("mbgw", "status")
    check_compiled(system)
    system.done("modbus-gateway", "demo", "--once")
    print(f"it installs and serves, {time.monotonic() - begin:.1f} s")


def check_compiled(system: BootedSystem) -> None:
    """The service cannot compile for itself."""
    assert (system.root / COMPILED.lstrip("/")).exists(), "nothing was compiled"


def check_runs_compiled(system: BootedSystem) -> None:
    """Debian's Python takes the modules that were compiled for it."""
    program = f"import sys; sys.path.insert(0, {LIBRARIES!r}); import gateway.lines.line as line; print(line.__file__)"
    where = system.done("python3", "-IS", "-c", program).strip()
    assert where.endswith(".so"), f"{where} runs"
    print(f"it runs {Path(where).name}")


def check_another_python(system: BootedSystem) -> None:
    """Debian's python3 becomes another version."""
    system.done("rm", "-r", COMPILED)
    system.done("run-parts", "--regex=^modbus-gateway", "--arg=rtupdate", "/usr/share/python3/runtime.d")
    check_compiled(system)
    print("it is compiled for another Python too")


def check_failed_upgrade(system: BootedSystem, package: Path) -> None:
    """An upgrade fails in the middle: what was there serves on."""
    shutil.copy(package, system.root / "root/package.deb")
    assert system.run("dpkg", "--install", "/root/package.deb").returncode != 0
    check_compiled(system)
    check_serving(system)
    print("an upgrade that fails leaves it as it was")


def check_documents(system: BootedSystem) -> None:
    """Pages can be read, and lead to what is there."""
    folder = system.root / "usr/share/doc/modbus-gateway"
    pages = list(folder.rglob("*.md"))
    assert pages, "there are no documents"
    for page in pages:
        for target in re.findall(r"\]\((?!http)([^)#]+)", page.read_text()):
            assert (page.parent / target).exists(), f"{page.relative_to(folder)} leads to {target}"
    for page in ("man1/mbgw.1.gz", "man5/modbus-gateway.toml.5.gz"):
        assert (system.root / "usr/share/man" / page).exists(), f"there is no {page}"
    print(f"{len(pages)} documents lead to what is there")


def check_upgrade(system: BootedSystem, package: Path) -> None:
    """Upgrade it, with a config that was changed here and there."""
    config = (system.root / CONFIG.lstrip("/")).read_text().replace("try-me", "mine")
    system.write(CONFIG, config)
    before = system.show("MainPID")
    assert "Open the page" not in install(system, package), "who upgrades knows the first steps"
    assert (system.root / CONFIG.lstrip("/")).read_text() == config, "the changes of the administrator are lost"
    assert system.show("MainPID") != before, "the old version still runs"
    check_serving(system)
    assert "mine" in system.done("modbus-gateway", "status")
    print("an upgrade keeps the config")


def check_removal(system: BootedSystem) -> None:
    """Remove it: what is the administrator's stays."""
    system.write(f"{STATE}/kept", "")
    system.done("dpkg", "--remove", "modbus-gateway")
    assert [system.show("ActiveState", unit) for unit in (SERVICE, SOCKET)] == ["inactive", "inactive"]
    assert system.done("find", "/usr", "-name", "*modbus*") == ""
    system.done("ls", CONFIG, f"{STATE}/kept")
    print("its removal keeps config and state")


def check_reload(system: BootedSystem) -> None:
    """A reload is complete when systemctl returns; unless Type=notify-reload, it fails if the file is wrong."""
    good = (system.root / CONFIG.lstrip("/")).read_text()
    system.write(CONFIG, good + "[[image]]\n")
    assert system.run("systemctl", "reload", SERVICE).returncode != 0, "a wrong file was not told"
    reload_with(system, good, 201)
    version = int(system.done("systemctl", "--version").split()[1])
    if version >= 253:  # the first one with Type=notify-reload
        system.override(SERVICE, "[Service]\nType=notify-reload\nExecReload=\nTimeoutStartSec=30\n")
        for unit in (202, 203, 204):
            reload_with(system, good, unit)
        system.end_overrides()
    system.write(CONFIG, good)
    system.done("systemctl", "restart", SERVICE)
    print(f"it reloads with systemd {version}")


def reload_with(system: BootedSystem, config: str, unit: int) -> None:
    """Add a unit of three registers, which answers at once after the reload."""
    system.write(CONFIG, f"{config}[[image]]\nunit = {unit}\nholding = 3\n")
    system.done("systemctl", "reload", SERVICE)
    with system.connect() as client:
        client.sendall(READ.replace(b"\xc8", bytes([unit])))
        assert client.recv(260)[6:9] == bytes([unit, 3, 6]), system.status()


def check_purge(system: BootedSystem) -> None:
    """Purge it: nothing stays."""
    purged = system.run("dpkg", "--purge", "modbus-gateway")
    assert (purged.returncode, purged.stderr) == (0, "")
    assert system.done("find", "/etc", "/usr", "/var/lib", "-name", "*modbus*") == ""
    print("nothing is left after a purge")


def main(release: str, built: str = "") -> None:
    """Check all of it; the first thing that is wrong ends it."""
    package = Path(built) if built else build()
    print(f"{package.name}, {package.stat().st_size / 1e6:.1f} MB, on Debian {release}")
    make(release)
    with tempfile.TemporaryDirectory() as folder, booted_bare(Path(folder), system_tree(release)) as system:
        check_installation(system, package)
        if built:
            check_runs_compiled(system)
        check_reload(system)
        check_another_python(system)
        check_failed_upgrade(system, newer(package, Path(folder), "#!/bin/sh\nexit 1\n"))
        check_documents(system)
        check_upgrade(system, newer(package, Path(folder)))
        check_removal(system)
        check_purge(system)


if __name__ == "__main__":
    main(*sys.argv[1:])
