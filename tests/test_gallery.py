"""The gallery has every task that comes with stlbench, and says of it what its file says."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "figures" / "gallery"
ROBOTS = ROOT / "docs" / "figures" / "robots"
SAID = """
import sys
sys.path.insert(0, "studies")
import gallery, json
films = json.loads((gallery.FOLDER / gallery.FILMED).read_text())
known = {name: gallery.Filmed(**each) for name, each in films.items()}
assert sorted(known) == gallery.tasks(), set(known) ^ set(gallery.tasks())
print(gallery.page(known), end="")
"""


def test_the_page_has_every_task_and_is_what_the_files_say() -> None:
    ran = subprocess.run([sys.executable, "-c", SAID], cwd=ROOT, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    assert (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8") == ran.stdout


def test_each_film_moves_and_begins_as_a_picture() -> None:
    every = *FOLDER.glob("*.webp"), *ROBOTS.glob("*.webp")
    films = sorted(path for path in every if not path.stem.endswith("-still"))
    assert len(films) >= 37
    for path in films:
        with Image.open(path) as film, Image.open(path.with_name(f"{path.stem}-still.webp")) as still:
            assert getattr(film, "n_frames", 1) >= 10, path
            assert getattr(still, "n_frames", 1) == 1
            assert film.size == still.size


def test_the_gallery_is_small() -> None:
    for folder in (FOLDER, ROBOTS):
        films = [path for path in folder.glob("*.webp") if not path.stem.endswith("-still")]
        assert sum(path.stat().st_size for path in folder.iterdir()) < 200_000 * len(films)
