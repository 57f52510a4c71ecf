"""A checkout works where it stands, installed or not, and the sdist carries all that the tests read."""

from pathlib import Path

import pytest
from doors import ROOT, python

# An editable installation maps sepv.properties and sepv.reference; here nothing does.
BARE = "import sys; sys.meta_path = [f for f in sys.meta_path if 'editable' not in str(f).lower()]; "


@pytest.mark.parametrize("name", ["sepv.reference", "sepv.properties", "sepv.reference.witnesses"])
def test_the_folders_at_the_top_are_found_from_a_bare_checkout(name: str) -> None:
    asked = f"{BARE}sys.path.insert(0, {str(ROOT)!r}); import {name}; print(*{name}.__path__)"
    assert Path(python(asked)) == ROOT.joinpath(*name.split(".")[1:])


def test_the_sdist_carries_every_folder_of_the_checkout() -> None:
    """setuptools adds the packages alone; the tests read pages, examples and records beside them."""
    manifest = (ROOT / "MANIFEST.in").read_text(encoding="utf-8").splitlines()
    grafted = {line.removeprefix("graft ") for line in manifest if line.startswith("graft ")}
    made_here = {line.strip("/") for line in (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()}
    folders = {p.name for p in ROOT.iterdir() if p.is_dir() and p.name not in (".git", "sepv", *made_here)}
    assert {f for f in folders if not f.endswith(".egg-info")} == grafted
