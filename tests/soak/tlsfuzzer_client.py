"""Runs one script of tlsfuzzer as a Modbus client with a certificate. fuzz_tlsfuzzer.py starts it.

    tlsfuzzer_client.py CERTIFICATE KEY SCRIPT ARGUMENTS

The scripts are for servers that ask for no certificate, speak HTTP, and have suites without authenticated encryption.
So each conversation is changed before it begins: a certificate is asked for and shown, and a read request is sent.
"""

import sys
from importlib import import_module
from pathlib import Path

from tlsfuzzer import expect, messages, runner
from tlslite.api import X509, X509CertChain, parsePEMKey
from tlslite.constants import CipherSuite

READ = bytes.fromhex("0001 0000 0006 C8 03 0000 0001")
#: What is offered in place of suites without authenticated encryption.
SUITES = {
    CipherSuite.TLS_ECDHE_RSA_WITH_AES_128_CBC_SHA: CipherSuite.TLS_ECDHE_RSA_WITH_AES_128_GCM_SHA256,
    CipherSuite.TLS_ECDHE_RSA_WITH_AES_256_CBC_SHA: CipherSuite.TLS_ECDHE_RSA_WITH_AES_256_GCM_SHA384,
}


class Certified:
    """Adds a certificate to conversations. Each is a graph: a message has one child, and siblings in place of it."""

    def __init__(self, certificate, key):
        self._chain = X509CertChain([X509().parse(Path(certificate).read_text())])
        self._key = parsePEMKey(Path(key).read_text(), private=True)

    def change(self, conversation):
        """Let the server ask for the certificate, and show it, in each whole handshake."""
        left, seen = [(conversation, False)], set()
        while left:
            before, is_asked = left.pop()
            for node in siblings(before.child):
                if node not in seen:
                    seen.add(node)
                    left.append((node, self._change(before, node, is_asked)))

    def _change(self, before, node, is_asked):
        """Change what is around `node`; whether the certificate is asked for, and not shown yet, behind it."""
        match node:
            case expect.ExpectServerHelloDone() if not is_asked:
                put_between(before, expect.ExpectCertificateRequest(), node)
            case expect.ExpectEncryptedExtensions() if is_whole_handshake(node):
                put_between(node, expect.ExpectCertificateRequest(), node.child)
            case expect.ExpectCertificateRequest():
                pass
            case messages.ClientKeyExchangeGenerator() if is_asked:
                put_between(before, messages.CertificateGenerator(self._chain), node)
                put_between(node, messages.CertificateVerifyGenerator(self._key), node.child)
                return False
            case messages.FinishedGenerator() if is_asked:
                put_between(before, messages.CertificateGenerator(self._chain), node)
                put_between(before.child, messages.CertificateVerifyGenerator(self._key), node)
                return False
            case expect.ExpectServerHello() | messages.CertificateGenerator():
                return False
            case _:
                return is_asked
        return True


def is_whole_handshake(node):
    return any(isinstance(each, expect.ExpectCertificate) for each in siblings(node.child))


def siblings(node):
    while node is not None:
        yield node
        node = node.next_sibling


def put_between(before, new, node):
    """Put `new` between `before` and its child `node`, unless that is only a sibling of its child."""
    if before.child is node:
        before.child, new.child = new, node


def main():
    certificate, key, script, *words = sys.argv[1:]
    certified = Certified(certificate, key)
    begin, ask, hello = (
        each.__init__ for each in (runner.Runner, messages.ApplicationDataGenerator, messages.ClientHelloGenerator)
    )

    def begin_certified(self, conversation):
        certified.change(conversation)
        begin(self, conversation)

    def ask_modbus(self, payload):
        ask(self, bytearray(READ) if payload.startswith(b"GET /") else payload)

    def offer(self, ciphers=None, *more, **named):
        hello(self, [SUITES.get(each, each) for each in ciphers or ()], *more, **named)

    runner.Runner.__init__ = begin_certified
    messages.ApplicationDataGenerator.__init__ = ask_modbus
    messages.ClientHelloGenerator.__init__ = offer
    sys.argv = [script, *words]
    import_module(f"tlsfuzzer._apps.{script}").main()


if __name__ == "__main__":
    main()
