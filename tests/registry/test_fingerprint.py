"""What is part of the code behind a module, and what is not; what has changed is named."""

from __future__ import annotations

import os
import pickle
import shutil
import sys

import pytest

from stlbench.registry import fingerprint as fingerprints
from stlbench.registry import plugins
from stlbench.registry.fingerprint import Code, code_of, own_code, revision

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


@pytest.mark.parametrize("edited", ["__init__", "one", "shared", "below", "deep/__init__", "deep/impl", "late"])
def test_an_edit_of_the_module_or_of_what_it_imports_from_its_package_is_seen(site, edited):
    root = site("acme", "", FILES)
    before = code_of("zz_pack.one").digest
    with (root / f"zz_pack/{edited}.py").open("a") as file:
        file.write("edited = 1\n")
    assert code_of("zz_pack.one").digest != before
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
    before = code_of("zz_pack.one").digest
    (root / "zz_pack/late.py").write_text("x = 2\n")
    assert code_of("zz_pack.one").digest != before


def test_an_edit_elsewhere_is_not_seen_and_the_place_does_not_matter(site):
    root = site("acme", "", FILES)
    before = code_of("zz_pack.one").digest
    (root / "zz_pack/other.py").write_text("y = 2\n")
    assert code_of("zz_pack.one").digest == before
    site("acme", "", FILES, folder="elsewhere")
    assert code_of("zz_pack.one").digest == before


def test_a_single_module_and_none_at_all(site):
    site("acme", "", FILES)
    assert code_of("zz_single").digest != code_of("zz_nowhere").digest
    assert [name for name, _ in code_of("zz_pack.nowhere").files] == ["zz_pack"]
    assert len(code_of("zz_nowhere").digest) == 32


def test_an_import_for_type_checkers_alone_is_not_followed(site):
    text = "import typing\nif typing.TYPE_CHECKING:\n    import zz_pack.late\nelse:\n    import zz_pack.other\n"
    site("acme", "", FILES | {"zz_pack/one.py": text})
    assert [name for name, _ in code_of("zz_pack.one").files] == ["zz_pack", "zz_pack.one", "zz_pack.other"]


def test_modules_of_other_packages_count_that_no_distribution_has_installed(site):
    files = FILES | {"zz_pack/one.py": "import zz_single\nfrom zz_help.tools import tool\n"}
    root = site("acme", "", files | {"zz_help/__init__.py": "", "zz_help/tools.py": "import zz_help.more\n"})
    (root / "zz_help/more.py").write_text("tool = 1\n")
    before = code_of("zz_pack.one").digest
    (root / "zz_help/more.py").write_text("tool = 2\n")
    assert code_of("zz_pack.one").digest != before
    before = code_of("zz_pack.one").digest
    (root / "zz_single.py").write_text("z = 2\n")
    assert code_of("zz_pack.one").digest != before


@pytest.fixture
def packages(site, monkeypatch):
    """Write files, of which those in `site-packages` are installed."""

    def install(files):
        monkeypatch.syspath_prepend(site("acme", "", files) / "site-packages")
        fingerprints.all_distributions.cache_clear()

    yield install
    fingerprints.all_distributions.cache_clear()


def test_installed_distributions_count_by_version_and_pythons_own_do_not(packages):
    installed = {
        "site-packages/zz_lib/__init__.py": "a = 1\n",
        "site-packages/Zz_Lib-3.4.dist-info/METADATA": "Metadata-Version: 2.1\nName: Zz_Lib\nVersion: 3.4\n",
        "site-packages/other_name/__init__.py": "",
        "site-packages/zz_other-5.dist-info/METADATA": "Metadata-Version: 2.1\nName: zz-other\nVersion: 5\n",
        "site-packages/zz_other-5.dist-info/top_level.txt": "other_name\n",
        "site-packages/zz_loose.py": "b = 1\n",
    }
    one = "import os, json.decoder, zz_lib.deep, other_name, zz_loose, zz_gone, stlbench\n"
    packages(FILES | {"zz_pack/one.py": one} | installed)
    code = code_of("zz_pack.one")
    assert code.packages == (("Zz_Lib", "3.4"), ("zz-other", "5"))
    assert [name for name, _ in code.files] == ["zz_loose", "zz_pack", "zz_pack.one"]
    assert code_of("zz_pack.one", packages=False).packages == ()


def test_own_code_is_what_is_not_installed_or_editable(packages):
    """An editable install has its metadata in site-packages, and its source elsewhere."""
    installed = {
        "site-packages/zz_lib/__init__.py": "import zz_single\n",
        "site-packages/Zz_Lib-3.4.dist-info/METADATA": "Metadata-Version: 2.1\nName: Zz_Lib\nVersion: 3.4\n",
        "site-packages/zz_edited-1.dist-info/METADATA": "Metadata-Version: 2.1\nName: zz-edited\nVersion: 1\n",
        "site-packages/zz_edited-1.dist-info/top_level.txt": "zz_edited\n",
        "zz_edited/__init__.py": "import zz_lib\n",
    }
    packages(FILES | installed)
    assert own_code(["os", "stlbench.task", "numpy", "zz_lib", "zz_gone"]) == Code()
    code = own_code(["zz_edited", "zz_single", "zz_lib"])
    assert [name for name, _ in code.files] == ["zz_edited", "zz_single"]
    assert code.packages == (("Zz_Lib", "3.4"),)


DATA = {
    "zz_pack/table.npz": "1",
    "zz_pack/data/deep/model.xml": "<a/>",
    "zz_pack/deep/of_another_package.csv": "1",
    "zz_pack/one.md": "words",
    "zz_pack/.hidden": "1",
    "zz_pack/py.typed": "",
    "zz_pack/out/ledger.sqlite": "",
    "zz_pack/out/figure.png": "1",
}


def test_data_beside_the_modules_counts_but_what_is_hidden_or_for_people(site):
    root = site("acme", "", FILES | DATA | {"zz_pack/one.py": "x = 1\n"})
    found = dict(code_of("zz_pack.one").files)
    assert found.keys() == {"zz_pack", "zz_pack.one", "zz_pack/table.npz", "zz_pack/data/deep/model.xml"}
    before = code_of("zz_pack.one").digest
    (root / "zz_pack/data/deep/model.xml").write_text("<b/>")
    assert code_of("zz_pack.one").digest != before
    before = code_of("zz_pack.one").digest
    (root / "zz_pack/new.json").write_text("{}")
    assert code_of("zz_pack.one").digest != before


def test_a_pipe_beside_the_modules_is_not_waited_for_and_a_circle_of_links_ends(site):
    root = site("acme", "", FILES)
    before = code_of("zz_pack.one").digest
    os.mkfifo(root / "zz_pack/pipe")
    (root / "zz_pack/again").symlink_to(root / "zz_pack")
    assert code_of("zz_pack.one").digest == before


@pytest.mark.parametrize("file", ["task.yaml", "by_hand.yaml"])
def test_what_a_task_file_says_is_watched_but_has_its_own_part_in_keys(site, file):
    root = site("acme", "", FILES | {f"zz_pack/{file}": "title: a\nsteps: 3\n"})
    code = code_of("zz_pack.one")
    (root / "zz_pack" / file).write_text("title: b\nsteps: 4\n")
    assert code.changed == str(root / "zz_pack" / file)
    assert code_of("zz_pack.one").digest == code.digest


def test_what_has_changed_is_named(site):
    root = site("acme", "", FILES | {"zz_pack/data.csv": "1,2\n"})
    code = pickle.loads(pickle.dumps(code_of("zz_pack.one")))
    assert code.changed is None
    late = root / "zz_pack/late.py"
    late.write_text("x = 1  # a comment\n")
    assert code.changed == str(late)
    late.unlink()
    assert code.changed == "zz_pack.late"
    late.write_text("x = 1\n")
    assert code.changed is None
    (root / "zz_pack/data.csv").write_text("1,3\n")
    assert code.changed == str(root / "zz_pack/data.csv")


def test_an_upgrade_of_what_is_imported_is_seen_by_the_same_process(site):
    site("acme", "", {"zz_mine.py": "import zz_lib\n"})
    root = site("zz-lib", "", {"zz_lib/__init__.py": ""}, folder="site-packages")
    code = code_of("zz_mine")
    assert (code.packages, code.changed) == ((("zz-lib", "1.2"),), None)
    shutil.rmtree(root / "zz_lib-1.2.dist-info")
    site("zz-lib", "", version="1.3", folder="site-packages")
    assert code.changed == "zz-lib"


def test_an_edit_that_keeps_size_and_second_is_seen(site):
    root = site("acme", "", FILES)
    code, late = code_of("zz_pack.one"), root / "zz_pack/late.py"
    then = late.stat()
    late.write_text("x = 2\n")
    os.utime(late, ns=(then.st_atime_ns, then.st_mtime_ns + 1_000_000))
    assert code.changed == str(late)


@pytest.mark.parametrize("text", ["def\n", "x = 1\0", b"\xff\xfe#", "x = " + "(" * 300])
def test_a_module_that_cannot_be_parsed_counts_by_its_bytes(site, text):
    root = site("acme", "", FILES)
    raw = text if isinstance(text, bytes) else text.encode()
    found = set()
    for content in (raw, raw + b"# more"):
        (root / "zz_pack/one.py").write_bytes(content)
        found.add(code_of("zz_pack.one").digest)
    assert len(found) == 2


def test_the_revision_stands_in_the_body_of_the_class_and_the_module_is_not_run(site):
    text = "raise RuntimeError\nrevision = 4\nclass One:\n    revision = 3\nclass Two(One):\n    size = 2\n"
    site("acme", "", FILES | {"zz_pack/one.py": text})
    assert [revision("zz_pack.one", name) for name in ("One", "Two", "", "Three")] == [3, 1, 4, 1]
    assert revision("zz_pack.late", "") == revision("zz_nowhere", "One") == 1


def test_the_revision_of_an_own_plugin_is_that_of_its_class():
    for kind in ("methods", "agents", "suites", "tasks"):
        for plugin in plugins.available(kind).values():
            if plugin.distribution == plugins.OWN:
                assert plugin.revision == vars(plugin.load()).get("revision", 1)


def test_the_harness_is_what_trains_and_scores_and_no_report_or_command_line():
    names = {name for name, _ in code_of("stlbench.study.trial").files}
    assert {"stlbench.simulation.referee", "stlbench.stl.recorded", "stlbench.task.starts"} <= names
    others = ("stlbench.cli", "stlbench.report", "stlbench.gate", "stlbench.records.ledger", "stlbench.study.run")
    assert not [name for name in names if f"{name}.".startswith(tuple(f"{other}." for other in others))]
