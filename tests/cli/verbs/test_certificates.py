"""`certificates`: what is replaced can still be revoked, and only what the authority has issued."""

import json
from pathlib import Path

import pytest

from gateway.cli import main
from gateway.tls.files import read_certificates
from gateway.tls.revoking import read_revoked
from kit.pki import openssl


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An authority that has issued `hmi` twice, and `hmi.2`."""
    assert run(tmp_path, "authority") == 0
    assert run(tmp_path, "client", "hmi", "--role", "operator") == 0
    (tmp_path / "first.crt").write_bytes((tmp_path / "hmi.crt").read_bytes())
    assert run(tmp_path, "client", "hmi", "--role", "operator", "--replace") == 0
    assert run(tmp_path, "client", "hmi.2") == 0
    return tmp_path


def run(folder: Path, *words: str) -> int:
    return main.main(["certificates", *words, "--folder", str(folder)])


def serial(file: Path) -> str:
    return read_certificates(file)[0].serial


def test_the_serial_number_is_that_of_openssl(folder: Path) -> None:
    said = openssl("x509", "-in", folder / "hmi.crt", "-noout", "-serial")
    assert said.strip() == f"serial={serial(folder / 'hmi.crt')}"


def test_who_replaces_a_certificate_is_told_that_the_one_before_is_valid(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(folder, "client", "hmi", "--replace") == 0
    assert f"certificates revoke hmi --replaced --folder {folder}" in capsys.readouterr().out
    assert run(folder, "client", "new") == 0
    assert "--replaced" not in capsys.readouterr().out


def test_what_was_replaced_is_revoked_and_the_certificate_in_use_is_not(folder: Path) -> None:
    assert run(folder, "revoke", "hmi", "--replaced") == 0
    listed = openssl("crl", "-in", folder / "ca.crl", "-noout", "-text")
    assert f"Serial Number: {serial(folder / 'first.crt')}\n" in listed
    assert listed.count("Serial Number") == 1
    assert run(folder, "revoke", "hmi", "--replaced") == 2  # nothing is left of that


def test_a_name_means_all_that_was_issued_to_it(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(folder, "revoke", "hmi") == 0
    both = {serial(folder / "first.crt"), serial(folder / "hmi.crt")}
    assert read_revoked(folder) == both
    capsys.readouterr()
    assert run(folder, "revoke", "hmi") == 0  # again: nothing changes
    assert capsys.readouterr().out.count("was revoked before") == 2
    assert read_revoked(folder) == both
    assert run(folder, "list", "--json") == 0
    states = {Path(row["file"]).stem: row["state"] for row in json.loads(capsys.readouterr().out)}
    assert states == {"ca": "", "first": "revoked", "hmi": "revoked", "hmi.2": ""}


def test_what_was_issued_before_copies_were_kept_is_kept_when_it_is_replaced(folder: Path) -> None:
    for file in (folder / "issued").iterdir():
        file.unlink()
    last = serial(folder / "hmi.crt")
    assert run(folder, "client", "hmi", "--replace") == 0
    assert run(folder, "revoke", "hmi", "--replaced") == 0
    assert read_revoked(folder) == {last}


def test_an_authority_revokes_only_what_it_has_issued(
    folder: Path, tmp_path_factory: pytest.TempPathFactory, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path_factory.mktemp("other")  # an authority of the same name
    assert run(other, "authority") == 0
    assert run(other, "client", "spy") == 0
    assert run(folder, "revoke", str(other / "spy.crt")) == 1
    assert f"spy.crt was not issued by {folder}/ca.crt" in capsys.readouterr().err
    assert run(folder, "revoke", str(folder / "ca.crt")) == 1
    assert "an authority cannot revoke itself" in capsys.readouterr().err
    assert run(folder, "revoke", "ca") == 2
    assert run(folder, "revoke", "nobody") == 2
    assert not (folder / "ca.crl").exists()


def test_an_expired_certificate_can_be_revoked(folder: Path) -> None:
    (folder / "settings").write_text(
        f"[ca]\ndefault_ca=own\n[own]\ndatabase={folder}/index\nnew_certs_dir={folder}\nrand_serial=yes\npolicy=any\n"
        f"certificate={folder}/ca.crt\nprivate_key={folder}/ca.key\ndefault_md=sha256\n[any]\ncommonName=supplied\n"
    )
    (folder / "index").write_text("")
    new_key = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-subj", "/CN=old")
    openssl("req", *new_key, "-keyout", folder / "old.key", "-out", folder / "old.csr")
    dates = ("-startdate", "20200101000000Z", "-enddate", "20200102000000Z")
    files = ("-in", folder / "old.csr", "-out", folder / "old.crt", "-notext")
    openssl("ca", "-batch", "-config", folder / "settings", *files, *dates)
    assert run(folder, "revoke", "old") == 0
    assert read_revoked(folder) == {serial(folder / "old.crt")}


def test_an_authority_does_not_begin_with_the_list_of_another_one(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(folder, "revoke", "hmi") == 0
    for file in ("ca.crt", "ca.key"):
        (folder / file).unlink()
    assert run(folder, "authority") == 1
    assert "ca.crl exists already, from another authority" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "what", "wanted"),
    [(("server", "gw", "--file", "hmi"), "client", "server"), (("client", "server"), "server", "client")],
)
def test_a_certificate_is_not_replaced_by_one_for_another_purpose(
    folder: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], what: str, wanted: str
) -> None:
    assert run(folder, "server", "gw.plant.local") == 0
    assert run(folder, "server", "gw.plant.local", "--replace") == 0
    file = folder / f"{words[-1]}.crt"
    before = file.read_bytes()
    assert run(folder, *words, "--replace") == 1
    said = f"{file} is the certificate of a {what}; choose another name for that of the {wanted}"
    assert said in capsys.readouterr().err
    assert file.read_bytes() == before
