"""What the page carries beside its text: values and plotly's script, compressed.

Browsers unpack it themselves (`DecompressionStream`, since 2023). plotly's wheel has one bundle, of 4.8 MB; packed it
takes 2 MB. It is unpacked when the first chart comes into view: to run it at once took four fifths of the time in
which a page opened.
"""

from __future__ import annotations

import base64
import gzip
import json
from functools import lru_cache
from importlib.util import find_spec
from typing import Any

from stlbench.errors import UsageError

_NEEDED = 'the page needs the packages jinja2 and plotly: pip install "stlbench-rl[page]"'


def packed(value: Any) -> str:
    """A value as JSON, compressed, in base64, which no HTML can be in."""
    return _packed(json.dumps(value, allow_nan=False, separators=(",", ":")).encode())


@lru_cache(maxsize=1)
def plotly() -> str:
    """plotly's script, packed."""
    require()
    from plotly.offline import get_plotlyjs

    return _packed(get_plotlyjs().encode())


def require() -> None:
    """Raises `UsageError` where the extra `page` is not installed."""
    if find_spec("jinja2") is None or find_spec("plotly") is None:
        raise UsageError(_NEEDED)


def _packed(content: bytes) -> str:
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()
