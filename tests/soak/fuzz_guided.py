"""The decoders of fuzz.py with inputs that lead to more and more of their code.

    .venv/bin/pip install atheris
    .venv/bin/python tests/soak/fuzz_guided.py -max_total_time=60

The promises are those of fuzz.py; its inputs are what the search begins with. All options are libFuzzer's. The search
ends with the first finding. Ends with status 0 if there was none; otherwise the input is printed that broke a promise.
"""

import sys
import tempfile
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Final

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[2])]

try:
    import atheris
except ImportError:
    sys.exit("atheris is not installed; .venv/bin/pip install atheris")

with atheris.instrument_imports(include=["gateway.modbus"]):
    from fuzz import DECODERS, LONGEST, Bytes, Decode, examine

#: Inputs of each decoder that the search begins with.
BEGINNINGS: Final = 200
#: An input begins with the number of its decoder and the seed of what the decoder expects.
HEAD: Final = 2


def decode_one(data: bytes) -> None:
    """One input.

    Raises:
        AssertionError: it broke a promise.
    """
    if len(data) <= HEAD:
        return
    number, seed = data[0] % len(DECODERS), data[1]
    finding = examine(data[HEAD:], _decoder(number, seed), seed)
    if finding:
        raise AssertionError(f"{DECODERS[number].__name__}: {finding}")


@cache
def _decoder(number: int, seed: int) -> Decode:
    return DECODERS[number](Bytes(seed))[1]


def write_beginnings(folder: Path) -> None:
    """Fill `folder` with inputs as they may come."""
    for number, make in enumerate(DECODERS):
        for seed in range(BEGINNINGS):
            given, _ = make(Bytes(seed))
            (folder / f"{number}-{seed}").write_bytes(bytes((number, seed)) + given)


def search(beginnings: str) -> None:
    """Search until told otherwise. Does not return: libFuzzer ends the process."""
    options = [f"-max_len={HEAD + LONGEST}", f"-artifact_prefix={beginnings}/"]
    atheris.Setup([*sys.argv, *options, beginnings], decode_one)
    atheris.Fuzz()


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        write_beginnings(Path(folder))
        searching = get_context("fork").Process(target=search, args=(folder,))
        searching.start()
        searching.join()
    return 1 if searching.exitcode else 0


if __name__ == "__main__":
    sys.exit(main())
