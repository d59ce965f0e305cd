"""What `check` says of the files that TLS needs."""

import shutil
from pathlib import Path

from gateway.config.load import load
from gateway.readconfig.file_troubles import certificate_troubles
from kit import pki
from kit.pki import listener

IMAGE = "[[image]]\nunit = 200\nholding = 10\n"


def troubles(tmp_path: Path, text: str) -> list[str]:
    file = tmp_path / "gateway.toml"
    file.write_text(IMAGE + text)
    return troubles_of(file)


def troubles_of(file: Path) -> list[str]:
    plan = load(file).plan
    assert plan is not None
    return [str(each) for each in certificate_troubles(plan, str(file))]


def test_good_files_are_fine(tmp_path: Path) -> None:
    assert troubles(tmp_path, listener()) == []


def test_a_file_that_cannot_be_used_is_named_with_its_table(tmp_path: Path) -> None:
    folder = tmp_path / "tls"
    shutil.copytree(pki.pki(), folder)
    (folder / "server.key").chmod(0o640)
    (folder / "server.crt").unlink()
    (said,) = troubles(tmp_path, listener().replace(str(pki.pki()), str(folder)))
    assert said.startswith(f"{tmp_path}/gateway.toml:4:1: warning: listen remote cannot be used: {folder}/server.crt: ")


def test_what_expires_soon_is_said(tmp_path: Path) -> None:
    folder = tmp_path / "tls"
    shutil.copytree(pki.pki(), folder)
    pki.making.make_server(folder, "server", ["localhost"], 20, replace=True)
    (said,) = troubles(tmp_path, listener().replace(str(pki.pki()), str(folder)))
    assert f"listen remote: {folder}/server.crt expires in 20 days" in said


def test_credentials_are_known_to_the_service_only(tmp_path: Path) -> None:
    text = listener().replace(f'"{pki.pki()}/server.key"', '{ credential = "server.key" }')
    assert troubles(tmp_path, text) == []


def test_the_file_with_the_table_is_named(tmp_path: Path) -> None:
    folder = tmp_path / "tls"
    shutil.copytree(pki.pki(), folder)
    (folder / "server.crt").unlink()
    text = listener().replace(str(pki.pki()), "tls")
    (tmp_path / "b.toml").write_text(text)
    (tmp_path / "gateway.toml").write_text(f'include = ["b.toml"]\n{IMAGE}')
    (said,) = troubles_of(tmp_path / "gateway.toml")
    assert said.startswith(f"{tmp_path}/b.toml:1:1: warning: listen remote cannot be used: {folder}/server.crt: ")
