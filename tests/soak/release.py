"""The release in dist/ is published to an index, a Debian repository and a registry here, and installed from there.

    nox -s soak -- release              all of it; `deploy/release` must have made dist/
    nox -s soak -- release index        or only: index, apt, image

It needs root and, of Debian: apt install reprepro mmdebstrap systemd-container buildah docker-registry. A Debian
with its Python stands in for Docker's image of Python. Status 0 if all went well.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from kit.free_port import free_port
from kit.system_tree import make, system_tree

CHECKOUT: Final = Path(__file__).resolve().parents[2]
DIST: Final = CHECKOUT / "dist"
ADDRESSES: Final = tomllib.loads((CHECKOUT / "deploy/project.toml").read_text(encoding="utf-8"))
PYTHON_IMAGE: Final = "docker.io/library/python:3.13-slim-trixie"
BASE_OF_IMAGES: Final = "python3-dev,python3-pip,python3-venv,python-is-python3,ca-certificates"
CERTIFICATES: Final = "/etc/ssl/certs/ca-certificates.crt"


def run(*words: str | Path, **variables: str) -> str:
    """Run a command, show it and how long it took; the end, if it fails. Returns what it printed."""
    began = time.monotonic()
    print("$", *words, flush=True)
    # Only what is named here tells where libraries are; nor is the gateway of this checkout seen.
    environment = {name: text for name, text in os.environ.items() if name not in {"PIP_FIND_LINKS", "PYTHONPATH"}}
    environment |= {"PIP_CONFIG_FILE": os.devnull} | variables
    done = subprocess.run(
        words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd="/", env=environment, check=False
    )
    if done.returncode:
        sys.exit(f"{done.stdout}\nstatus {done.returncode}")
    print(f"  {time.monotonic() - began:.1f} s: {done.stdout.strip().rpartition(chr(10))[2]}")
    return done.stdout


@contextmanager
def server(url: str, *words: str | Path) -> Iterator[None]:
    """A server of this machine, once it answers, until the end."""
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            run("curl", "--silent", "--show-error", "--fail", "--retry", "20", "--retry-connrefused", url)
            yield
        finally:
            process.terminate()


def demo(*words: str | Path, **variables: str) -> None:
    """Have the demo ask every device."""
    if "0 wrong" not in run(*words, "demo", "--once", **variables):
        sys.exit("the demo has wrong or missing responses")


def index(folder: Path) -> None:
    """Upload to an index as PyPI is one, and install with pip, pipx and uvx."""
    port, packages = free_port(), folder / "packages"
    url = f"http://127.0.0.1:{port}"
    packages.mkdir()
    python_packages = (*DIST.glob("*.whl"), *DIST.glob("*.tar.gz"))
    serve = (
        "uvx",
        "--from",
        "pypiserver",
        "pypi-server",
        "run",
        "-p",
        str(port),
        "-i",
        "127.0.0.1",
        "-a",
        ".",
        "-P",
        ".",
    )
    with server(url, *serve, packages):
        run("uvx", "twine", "upload", "--repository-url", url, "-u", "x", "-p", "x", *python_packages)
        environment = folder / "environment"
        run(sys.executable, "-m", "venv", environment)
        run(environment / "bin/pip", "install", "--index-url", f"{url}/simple/", "mbgw[web]")
        run(environment / "bin/python", "-c", "import gateway.lines.line as line; print(line.__file__)")
        demo(environment / "bin/mbgw")
        pipx = {"PIPX_HOME": str(folder / "pipx"), "PIPX_BIN_DIR": str(folder / "bin")}
        run("uvx", "pipx", "install", "--index-url", f"{url}/simple/", "mbgw[web,mqtt,fleet,yaml]", **pipx)
        demo(folder / "bin/mbgw")
        demo("uvx", "--no-cache", "--index", f"{url}/simple/", "mbgw")


def apt(folder: Path) -> None:
    """Sign a Debian repository with a throw-away key, and install from it in a new Debian as docs/install.md says."""
    keys = folder / "keys"
    keys.mkdir(mode=0o700)
    generate = ("gpg", "--batch", "--passphrase", "", "--quick-generate-key", "trial", "ed25519", "sign", "never")
    run(*generate, GNUPGHOME=str(keys))
    port = free_port()
    url = f"http://127.0.0.1:{port}"
    packages = DIST.glob("*.deb")
    run(CHECKOUT / "deploy/apt-repository", folder / "site/debian", f"{url}/debian", *packages, GNUPGHOME=str(keys))
    page = (CHECKOUT / "docs/install.md").read_text(encoding="utf-8").partition("\n## Debian 12")[2]
    commands = [line.strip() for line in page.partition("\n\nThat")[0].splitlines() if line.startswith("    ")]
    told = " -y &&".join([*commands, "modbus-gateway check"]).replace("sudo ", "")
    told = told.replace(ADDRESSES["documentation"], url).replace(".sources -y", ".sources")
    first = "export DEBIAN_FRONTEND=noninteractive && apt-get update -qq && apt-get install -qq wget"
    make()
    with server(url, sys.executable, "-m", "http.server", str(port), "--bind", "127.0.0.1", "-d", folder / "site"):
        nspawn = ("systemd-nspawn", "--quiet", "--register=no", "--keep-unit", "--pipe", "--volatile=overlay")
        said = run(*nspawn, f"--directory={system_tree()}", "sh", "-c", f"{first} && {told}")
        print(said[said.rindex("Setting up modbus-gateway") :])


def image(folder: Path) -> None:
    """Build the image and the one of the add-on, push them to a registry, pull and run them from there."""
    port = free_port()
    place, version = f"127.0.0.1:{port}/modbus-gateway", next(DIST.glob("*.tar.gz")).name[5:-7]
    deploy, variables = CHECKOUT / "deploy", {"STORAGE_DRIVER": "vfs", "BUILDAH_ISOLATION": "chroot"}

    def buildah(store: str, *words: str | Path) -> str:
        return run("buildah", "--root", folder / store, "--runroot", folder / f"{store}.run", *words, **variables)

    def build(*words: str | Path) -> None:
        trusted = f"{CERTIFICATES}:{CERTIFICATES}:ro"
        buildah("built", "bud", "--quiet", "--pull-never", "--network", "host", "--volume", trusted, *words)

    run("mmdebstrap", "--variant=minbase", f"--include={BASE_OF_IMAGES}", "trixie", folder / "base.tar")
    (folder / "Dockerfile").write_text(
        "FROM scratch\nADD base.tar /\n"
        f"ENV PIP_BREAK_SYSTEM_PACKAGES=1 PIP_CERT={CERTIFICATES} SSL_CERT_FILE={CERTIFICATES}\n"
    )
    build("--tag", PYTHON_IMAGE, folder)
    name = f"{ADDRESSES['image']}:{version}"
    build("--tag", name, "--file", deploy / "Dockerfile", "--ignorefile", deploy / "Dockerfile.dockerignore", CHECKOUT)
    build("--tag", f"{place}/home-assistant", "--build-arg", f"VERSION={version}", deploy / "homeassistant")
    config, storage = folder / "registry.yml", {"filesystem": {"rootdirectory": f"{folder}/registry"}}
    config.write_text(json.dumps({"version": 0.1, "storage": storage, "http": {"addr": f"127.0.0.1:{port}"}}))
    with server(f"http://127.0.0.1:{port}/v2/", "docker-registry", "serve", config):
        for built, pushed in ((name, f"{place}:{version}"), (f"{place}/home-assistant", f"{place}/home-assistant")):
            buildah("built", "push", "--quiet", "--tls-verify=false", built, f"docker://{pushed}")
        for pulled, words in (
            (f"{place}:{version}", ("demo", "--once")),
            (f"{place}/home-assistant", ("check", "/usr/share/modbus-gateway/gateway.toml")),
        ):
            container = buildah("fresh", "from", "--quiet", "--pull-always", "--tls-verify=false", pulled).strip()
            print(buildah("fresh", "run", container, "--", "modbus-gateway", *words)[:300])


def main() -> None:
    """Do what is named, or all."""
    steps = {step.__name__: step for step in (index, apt, image)}
    for name in sys.argv[1:] or steps:
        folder = Path(tempfile.mkdtemp(prefix=f"release-{name}."))
        steps[name](folder)
        shutil.rmtree(folder)
        print(f"{name}: all went well\n")


if __name__ == "__main__":
    main()
