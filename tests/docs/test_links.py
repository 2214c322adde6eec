"""Every link between the pages leads to a file, and to a heading that is there."""

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")]


def anchors(page: Path) -> set[str]:
    """The headings of a page as links name them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\((?!https?:)([^)]+)\)", page.read_text(encoding="utf-8")):
        name, _, heading = target.partition("#")
        file = page.parent / name if name else page
        assert file.exists(), target
        assert not heading or heading in anchors(file), target


def test_every_page_is_in_the_navigation_of_the_site_and_in_the_list_of_pages() -> None:
    site = (ROOT / "zensical.toml").read_text(encoding="utf-8")
    listed = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    for page in (ROOT / "docs").glob("*.md"):
        assert f'"{page.name}"' in site, page.name
        assert f"({page.name})" in listed or page.name in ("README.md", "benchmarks.md"), page.name


def test_no_page_of_the_site_links_to_what_the_site_has_not() -> None:
    """`make docs` would refuse it. The site lacks folders of the checkout that pages lie beside."""
    stage = runpy.run_path(str(ROOT / "tools" / "docs.py"))["stage"]
    assert stage() == []
