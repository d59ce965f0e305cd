"""Runs the command line: `python -m gateway` is `modbus-gateway`."""

import sys

from gateway.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
