"""A program that uses the library as the docs do has no wrong type for pyright (strict); for mypy: `nox -s types`."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from library.guide import EXAMPLES, files_of_the_guide

pytest.importorskip("basedpyright", reason="it has no wheel for this machine")
ROOT = EXAMPLES.parents[1]


def test_pyright_finds_nothing_in_the_examples_and_in_the_guide(tmp_path: Path) -> None:
    programs = {file.name: file.read_text(encoding="utf-8") for file in EXAMPLES.glob("*.py")}
    programs |= {name: text for name, text in files_of_the_guide().items() if name.endswith(".py")}
    assert sorted(programs) == ["computed_meter.py", "inside_aiohttp.py", "plant.py"]
    for name, text in programs.items():
        (tmp_path / name).write_text(text)
    settings = tmp_path / "pyrightconfig.json"
    settings.write_text(json.dumps({"typeCheckingMode": "strict", "extraPaths": [str(ROOT)]}))
    checked = subprocess.run(
        [sys.executable, "-m", "basedpyright", "-p", settings, "--pythonpath", sys.executable, "--outputjson"],
        capture_output=True,
        text=True,
        check=False,
    )
    found = json.loads(checked.stdout)
    assert found["summary"]["filesAnalyzed"] == len(programs)
    assert [f"{Path(each['file']).name}: {each['message']}" for each in found["generalDiagnostics"]] == []
