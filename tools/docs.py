"""Build the documentation's site from docs/: `make docs`. Any broken link ends it with status 1.

Pages link to files beside docs/ as they lie in the checkout; the site gets copies of these. The
reference is made from the docstrings of what cohelm exports, one entry for each name of `__all__`.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DOCS, STAGED, SITE = ROOT / "docs", ROOT / "out" / "docs", ROOT / "out" / "site"
PAGES = ("CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md", "LICENSE")
"""Pages that lie at the top of the checkout."""
_UP = re.compile(r"\]\(\.\./([^)#\s]+)(#[^)\s]*)?\)")
_IN_DOCS = re.compile(r"\]\(docs/([^)\s]*)\)")
_PLAIN = re.compile(r"\]\((?!https?:|mailto:|#)([^)#\s]+)(#[^)\s]*)?\)")


def main() -> None:
    """Stage the pages, check their links, build."""
    broken = stage()
    if broken:
        sys.exit("broken links in the documentation:\n" + "\n".join(broken))
    zensical = Path(sys.executable).with_name("zensical")
    said = subprocess.run((zensical, "build", "--clean", "--strict"), cwd=ROOT)
    if said.returncode != 0:
        sys.exit(said.returncode)
    entries = (SITE / "reference.html").read_text(encoding="utf-8")
    missing = [name for name in exported() if not re.search(rf"^\s*cohelm\.{name}$", entries, re.M)]
    if missing:
        sys.exit(f"the reference has no entry for {', '.join(missing)}")
    print(f"the site is in {SITE.relative_to(ROOT)}; open {SITE / 'index.html'}")


def stage() -> list[str]:
    """Write the site's pages to STAGED; returns their broken links."""
    shutil.rmtree(STAGED, ignore_errors=True)
    shutil.copytree(DOCS, STAGED)
    for name in PAGES:
        if (ROOT / name).is_file():
            shutil.copy(ROOT / name, STAGED / name)
    (STAGED / "reference.md").write_text(reference(), encoding="utf-8")
    for page in STAGED.glob("*.md"):
        page.write_text(_relinked(page.read_text(encoding="utf-8")), encoding="utf-8")
    return [line for page in sorted(STAGED.glob("*.md")) for line in _broken(page)]


def exported() -> list[str]:
    """What cohelm promises to keep."""
    import cohelm

    return list(getattr(cohelm, "__all__", ["__version__"]))


def reference() -> str:
    """The page of the reference."""
    entries = "\n\n".join(_entry(name) for name in exported())
    about = "Everything that `import cohelm` offers. SI units and radians."
    return f"# Reference\n\n{about}\n\n{entries}\n"


def _entry(name: str) -> str:
    """One name under the name that users import. `cohelm.drive` is also a room: hence its home."""
    import cohelm

    home = getattr(cohelm, name).__module__
    return f"::: {home}.{name}\n    options:\n      heading: cohelm.{name}\n      toc_label: {name}"


def _relinked(text: str) -> str:
    """Links out of docs/ to the copies of what they mean."""

    def copied(found: re.Match[str]) -> str:
        path, anchor = found[1], found[2] or ""
        if path in PAGES:
            return f"]({path}{anchor})"
        source = ROOT / path
        if not source.is_file():
            return found[0]  # told as broken
        # under another suffix a page or a program would be taken for the site's own
        target = Path("files") / f"{path}.txt"
        (STAGED / target).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source, STAGED / target)
        return f"]({target.as_posix()}{anchor})"

    return _IN_DOCS.sub(r"](\1)", _UP.sub(copied, text))


def _broken(page: Path) -> list[str]:
    """Links of a page to what is not there."""
    found: list[str] = []
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        for link in _PLAIN.finditer(re.sub(r"`[^`]*`", "", line)):
            if not (page.parent / link[1]).exists():
                found.append(f"{page.name}:{number}: {link[1]}")
    return found


if __name__ == "__main__":
    main()
