"""Adds the compiled request path to a wheel, which then fits one version of Python and one kind of machine.

Hatch calls this for each wheel. Where there is no C compiler or no headers of Python, the wheel is pure Python and fits
everywhere; with HATCH_BUILD_NO_HOOKS=true it always is. With HATCH_BUILD_HOOK_ENABLE_CUSTOM=1 a wheel that cannot be
compiled is an error. Why: docs/adr/0012-compiled-request-path.md.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CompiledModules(BuildHookInterface[Any]):
    """Hatch's build hook."""

    def dependencies(self) -> list[str]:
        """What compiles: nothing is fetched where nothing can be compiled."""
        return [] if why_not() else ["mypy>=1.14", "setuptools>=78"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile a copy of the package, and name what comes of it for the wheel. A checkout is never compiled."""
        self._folder = TemporaryDirectory()
        if version == "editable":
            return
        if reason := why_not():
            self._leave_out(reason)
            return
        folder, root = Path(self._folder.name), Path(self.root)
        shutil.copytree(root / "gateway", folder / "gateway")
        without_symbols = os.environ | {"LDFLAGS": "-s"}
        done = subprocess.run([sys.executable, root / "deploy/compile", folder], check=False, env=without_symbols)
        if done.returncode:
            self._leave_out("deploy/compile has failed, see above")
            return
        compiled = folder.rglob("*.so")
        build_data["force_include"] |= {str(path): str(path.relative_to(folder)) for path in compiled}
        build_data["pure_python"] = False
        build_data["infer_tag"] = True

    def finalize(self, _version: str, _build_data: dict[str, Any], _artifact: str) -> None:
        """Remove the copy."""
        self._folder.cleanup()

    def _leave_out(self, reason: str) -> None:
        if must_compile():
            self.app.abort(f"mbgw: not compiled: {reason}")
        self.app.display_warning(f"mbgw: not compiled, which costs twice the processor time and nothing else: {reason}")


def must_compile() -> bool:
    """Whether a wheel that is not compiled is of no use: those of a release."""
    return os.environ.get("HATCH_BUILD_HOOK_ENABLE_CUSTOM") in {"1", "true"}


def why_not() -> str:
    """Why nothing can be compiled here; nothing if it can be."""
    compiler = (os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc").split()[0]
    headers = Path(sysconfig.get_path("include"), "Python.h")
    if sys.implementation.name != "cpython":
        return f"{sys.implementation.name} takes no such modules"
    if not shutil.which(compiler):
        return f"there is no {compiler} (Debian: apt install gcc libc6-dev)"
    return "" if headers.exists() else f"there is no {headers} (Debian: apt install python3-dev)"
