"""A gateway for one line, for a benchmark to measure: `naive_gateway.py run CONFIG`. It takes one request at a time.

With `FAULTY=1` in its environment it has every fault that a benchmark must notice: some requests are never answered,
some get an exception, some the answer to another one, and it keeps no silence on the line. A busy machine would make
one: so some requests are sent twice at once.
"""

import os
import selectors
import socket
import sys
import time
import tomllib
from pathlib import Path

import fastcrc

IS_FAULTY = "FAULTY" in os.environ
SILENCE = 0.005


def main() -> None:
    config = tomllib.loads(Path(sys.argv[2]).read_text())
    line = os.open(config["line"][0]["port"], os.O_RDWR | os.O_NOCTTY)
    listener = socket.create_server(("127.0.0.1", int(config["listen"][0]["bind"].rpartition(":")[2])))
    with selectors.DefaultSelector() as selector:
        selector.register(listener, selectors.EVENT_READ)
        number = 0
        while True:
            for key, _ in selector.select():
                if key.fileobj is listener:
                    selector.register(listener.accept()[0], selectors.EVENT_READ)
                elif adu := key.fileobj.recv(12):
                    number += 1
                    serve(number, adu, key.fileobj, line)
                else:
                    selector.unregister(key.fileobj)
                    key.fileobj.close()


def serve(number: int, adu: bytes, client: socket.socket, line: int) -> None:
    fault = number % 10 if IS_FAULTY else None
    if fault == 4:
        os.write(line, framed(adu[6:]) * 2)
        return
    pdu = ask(adu[6:], line)
    if fault == 1:
        return
    if fault == 2:
        pdu = bytes((pdu[0] | 0x80, 0x0B))
    if fault == 3:
        pdu = pdu[:2] + pdu[4:] + pdu[2:4]
    client.sendall(adu[:5] + bytes((1 + len(pdu), adu[6])) + pdu)


def ask(request: bytes, line: int) -> bytes:
    """The response PDU to a read request, unit and PDU."""
    if not IS_FAULTY:
        time.sleep(SILENCE)
    os.write(line, framed(request))
    response = b""
    while len(response) < 5 + 2 * request[5]:
        response += os.read(line, 256)
    return response[1:-2]


def framed(request: bytes) -> bytes:
    return request + fastcrc.crc16.modbus(request).to_bytes(2, "little")


if __name__ == "__main__":
    main()
