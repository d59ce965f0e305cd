"""Scripts of tlsfuzzer against a TLS listener: what it does with handshakes and records that break the protocol.

    git clone https://github.com/tlsfuzzer/tlsfuzzer
    .venv/bin/pip install --pre tlslite-ng
    .venv/bin/python tests/soak/fuzz_tlsfuzzer.py tlsfuzzer

Each script expects an answer to each message, an alert in most cases, and ends with status 1 otherwise; so does this.
Afterwards a client is served, and nothing has failed in the gateway. Left out are scripts for what the listener does
not have (RSA key exchange, CBC, renegotiation, early data, OCSP), and for what OpenSSL does otherwise.
"""

import argparse
import os
import socket
import ssl
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from gateway.modbus.mbap import encode
from kit.pki import OPERATOR, client_context, listener, openssl, pki
from kit.process import GatewayProcess

CLIENT = Path(__file__).with_name("tlsfuzzer_client.py")
PATIENCE = 300.0
#: A certificate and its key are arguments too; many cases are tried by a sample.
CERTIFICATE, SAMPLE = ["-k", "KEY", "-c", "CERTIFICATE"], ["-n", "40"]
#: With ECDHE, for TLS 1.2.
OLD = ["-d"]


def without(*probes: str) -> list[str]:
    return [word for probe in probes for word in ("-e", probe)]


#: A message that is padded to many records may be refused at any of them: the script expects one of several alerts.
HUGE = without(
    *(
        f"padding - cipher {suite}, pad_byte 0, pad_left 0, pad_right {size}"
        for suite, digest in (("TLS_AES_128_GCM_SHA256", 32), ("TLS_AES_256_GCM_SHA384", 48))
        for size in (0x20000, 0x30000, 256**3 - 1 - digest)
    )
)
SCRIPTS = {
    "test_tls13_0rtt_garbage": without("handshake with invalid 0-RTT and unknown version (downgrade to TLS 1.2)"),
    "test_tls13_ccs": [],
    # the client's certificate may have a key of a kind that the script does not know
    "test_tls13_certificate_verify": [*CERTIFICATE, *SAMPLE, *without("check sigalgs in cert request")],
    "test_tls13_connection_abort": SAMPLE,
    "test_tls13_conversation": [],
    "test_tls13_ecdhe_curves": [],
    "test_tls13_empty_alert": [],
    "test_tls13_finished": [*SAMPLE, *HUGE],
    "test_tls13_hrr": [],
    "test_tls13_invalid_ciphers": SAMPLE,
    "test_tls13_keyshare_omitted": [],
    # half of a request
    "test_tls13_keyupdate": [*SAMPLE, *without("app data split, conversation with KeyUpdate msg")],
    "test_tls13_nociphers": [],
    "test_tls13_pkcs_signature": [],
    "test_tls13_record_padding": [],
    # more than 64 KiB are refused
    "test_tls13_signature_algorithms": [
        *SAMPLE,
        *without("tolerance 32715 methods", "tolerance 32715 methods with sig_alg_cert"),
    ],
    "test_tls13_unencrypted_alert": [],
    # the request before it is whole, and answered
    "test_tls13_zero_content_type": without(
        "zero content type during application data", "zero content type and padding during application data"
    ),
    "test_aes_gcm_nonces": OLD,
    "test_ccs": OLD,
    "test_certificate_malformed": [*OLD, *CERTIFICATE, *SAMPLE],
    "test_certificate_verify": [*OLD, *CERTIFICATE],
    "test_certificate_verify_malformed": [*OLD, *CERTIFICATE, *SAMPLE],
    "test_connection_abort": [*OLD, *SAMPLE],
    "test_conversation": OLD,
    "test_early_application_data": OLD,
    "test_ecdhe_rsa_key_exchange_with_bad_messages": [],
    "test_hello_request_by_client": OLD,
    "test_invalid_client_hello_w_record_overflow": [*OLD, *SAMPLE],
    "test_invalid_content_type": OLD,
    "test_large_number_of_extensions": [*OLD, *without("16375 extensions")],
    "test_no_heartbeat": OLD,
    "test_record_layer_fragmentation": [*OLD, *without("maximum size: max fragment - 65385B extension")],
    "test_sessionID_resumption": OLD,
    "test_ssl_death_alert": OLD,
    "test_truncating_of_client_hello": [*OLD, *SAMPLE, *without('big pad: 65536 of "0" byte padding')],
    "test_version_numbers": OLD,
    "test_zero_length_data": OLD,
}


def main() -> int:
    """Run each script; 1 if one of them, or the gateway, has failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tlsfuzzer", type=Path, help="the folder of tlsfuzzer")
    parser.add_argument("--only", nargs="+", choices=SCRIPTS, default=list(SCRIPTS), help="these scripts")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _make_rsa(folder)
        config = listener().replace(f"{pki()}/server.", f"{folder}/server.") + "[[image]]\nunit = 200\nholding = 10\n"
        with GatewayProcess(folder, config, level="info") as gateway:
            failed = [each for each in args.only if not _passes(each, args.tlsfuzzer, folder, gateway.port)]
            assert _is_served(gateway.port), "a good client is not served"
            broken = [each for each in gateway.log if each["event"] == "part_failed"] + gateway.rest
    print(*broken, f"{len(args.only)} scripts, {len(failed)} have failed", sep="\n")
    return int(bool(failed or broken))


def _make_rsa(folder: Path) -> None:
    """Certificates with RSA, which the scripts ask for: a server's that nobody checks, and a client's."""
    for name, words in (("server", ["-x509", "-days", "90"]), ("client", ["-CA", pki() / "ca.crt", "-x509"])):
        signer = ["-CAkey", pki() / "ca.key"] if "-CA" in words else []
        key, certificate = folder / f"{name}.key", folder / f"{name}.crt"
        openssl(
            "req", *words, *signer, "-newkey", "rsa:2048", "-nodes", "-subj", f"/CN={name}", "-keyout", key,
            "-out", certificate,
        )  # fmt: skip
        key.chmod(0o600)


def _is_served(port: int) -> bool:
    context = client_context(OPERATOR)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    plain = socket.create_connection(("127.0.0.1", port), PATIENCE)
    with plain, context.wrap_socket(plain) as client:
        client.sendall(encode(1, 200, bytes.fromhex("03 0000 0001")))
        return client.recv(260)[7:9] == b"\x03\x02"


def _passes(script: str, tlsfuzzer: Path, folder: Path, port: int) -> bool:
    files = {"KEY": str(folder / "client.key"), "CERTIFICATE": str(folder / "client.crt")}
    words = [files.get(word, word) for word in SCRIPTS[script]]
    command = [sys.executable, CLIENT, files["CERTIFICATE"], files["KEY"], script, "-p", str(port), *words]
    environment = {**os.environ, "PYTHONPATH": str(tlsfuzzer.absolute())}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE, check=False)
    counts = dict(line.split(": ") for line in done.stdout.splitlines() if line.startswith(("PASS: ", "FAIL: ")))
    print(f"{script}: {counts or done.stderr}", flush=True)
    if done.returncode:
        print(done.stdout[-3000:])
    return done.returncode == 0


if __name__ == "__main__":
    sys.exit(main())
