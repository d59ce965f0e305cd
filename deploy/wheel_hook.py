"""Adds the compiled request path to a wheel, which then fits one version of Python and one kind of machine.

Hatch calls this where HATCH_BUILD_HOOK_ENABLE_CUSTOM=1 is set; any other wheel is pure Python and fits everywhere.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CompiledModules(BuildHookInterface[Any]):
    """Hatch's build hook."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile a copy of the package, and name what comes of it for the wheel. A checkout is never compiled."""
        if version == "editable":
            return
        self._folder = TemporaryDirectory()
        folder, root = Path(self._folder.name), Path(self.root)
        shutil.copytree(root / "gateway", folder / "gateway")
        without_symbols = os.environ | {"LDFLAGS": "-s"}
        subprocess.run([sys.executable, root / "deploy/compile", folder], check=True, env=without_symbols)
        compiled = folder.rglob("*.so")
        build_data["force_include"] |= {str(path): str(path.relative_to(folder)) for path in compiled}
        build_data["pure_python"] = False
        build_data["infer_tag"] = True

    def finalize(self, version: str, _build_data: dict[str, Any], _artifact: str) -> None:
        """Remove the copy."""
        if version != "editable":
            self._folder.cleanup()
