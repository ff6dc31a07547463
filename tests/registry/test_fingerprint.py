"""What changes the digest of a plugin's source, and what does not."""

from __future__ import annotations

import sys

import pytest

from stlbench.registry.fingerprint import fingerprint

FILES = {
    "zz_pack/__init__.py": "raise RuntimeError('never run')",
    "zz_pack/one.py": "import os\nfrom zz_pack import shared\nfrom .deep import thing\n",
    "zz_pack/shared.py": "import zz_pack.below\n",
    "zz_pack/below.py": "from . import one\n",  # a circle
    "zz_pack/deep/__init__.py": "from .impl import thing\n",
    "zz_pack/deep/impl.py": "from ..late import x\n",
    "zz_pack/late.py": "x = 1\n",
    "zz_pack/other.py": "y = 1\n",
    "zz_single.py": "z = 1\n",
}


@pytest.mark.parametrize("edited", ["one", "shared", "below", "deep/__init__", "deep/impl", "late"])
def test_an_edit_of_the_module_or_of_what_it_imports_from_its_package_is_seen(site, edited):
    root = site("acme", "", FILES)
    before = fingerprint("zz_pack.one")
    with (root / f"zz_pack/{edited}.py").open("a") as file:
        file.write("# edited\n")
    assert fingerprint("zz_pack.one") != before
    assert "zz_pack" not in sys.modules


BLOCKS = [
    "def f():\n    {}",
    "async def f():\n    {}",
    "class C:\n    def f(self):\n        {}",
    "if x:\n    pass\nelif y:\n    {}\nelse:\n    pass",
    "if x:\n    pass\nelse:\n    {}",
    "for i in x:\n    {}",
    "while x:\n    {}",
    "with x:\n    {}",
    "try:\n    {}\nexcept Exception:\n    pass",
    "try:\n    pass\nexcept Exception:\n    {}\nelse:\n    pass",
    "try:\n    pass\nexcept* Exception:\n    pass\nelse:\n    {}",
    "try:\n    pass\nfinally:\n    {}",
    "match x:\n    case 1:\n        {}",
]


@pytest.mark.parametrize("block", BLOCKS)
def test_an_import_inside_any_block_is_seen(site, block):
    root = site("acme", "", FILES | {"zz_pack/one.py": block.format("from zz_pack.late import x") + "\n"})
    before = fingerprint("zz_pack.one")
    (root / "zz_pack/late.py").write_text("x = 2\n")
    assert fingerprint("zz_pack.one") != before


def test_an_edit_elsewhere_is_not_seen_and_the_place_does_not_matter(site):
    root = site("acme", "", FILES)
    before = fingerprint("zz_pack.one")
    (root / "zz_pack/other.py").write_text("y = 2\n")
    assert fingerprint("zz_pack.one") == before
    site("acme", "", FILES, folder="elsewhere")
    assert fingerprint("zz_pack.one") == before


def test_a_single_module_and_none_at_all(site):
    site("acme", "", FILES)
    assert fingerprint("zz_single") != fingerprint("zz_nowhere") == fingerprint("zz_pack.nowhere")
    assert len(fingerprint("zz_nowhere")) == 32


def test_source_that_does_not_parse_still_has_a_digest(site):
    root = site("acme", "", {"zz_single.py": "def\n"})
    before = fingerprint("zz_single")
    (root / "zz_single.py").write_text("class\n")
    assert fingerprint("zz_single") != before
