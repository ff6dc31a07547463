"""The process that imports everything once, and from which the keepers of all items are forked."""

from __future__ import annotations

import gc
import os
import pickle
import sys
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from types import ModuleType
from typing import Any

import psutil

from stlbench_executors import tree
from stlbench_executors.keeper import keep


class Server(SpawnProcess):
    """A fresh interpreter, which does not run the user's script again, as a spawned one does.

    Args:
        links: the far end of the link to each keeper.
        limit: bytes of memory that the processes of an item may take together.
        prepare: pickled: what to call before the first item. What it raises is passed over: an item meets it again.
    """

    def __init__(self, links: Sequence[Connection], limit: int, prepare: bytes) -> None:
        super().__init__(target=_serve, args=(links, limit, prepare))

    @staticmethod
    def _Popen(process: Any) -> Any:  # noqa: N802 - the name is that of multiprocessing
        script = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            return SpawnProcess._Popen(process)
        finally:
            sys.modules["__main__"] = script


def _serve(links: Sequence[Connection], limit: int, prepare: bytes) -> None:
    os.setsid()  # a ctrl-C in the terminal is for the harness
    tree.adopt()
    with suppress(BaseException):
        pickle.loads(prepare)()  # noqa: S301 - from our own parent
    if psutil.Process().num_threads() > 1:
        os._exit(1)  # a fork would copy locks that nobody lets go of; the next server prepares nothing
    gc.collect()
    gc.freeze()  # what is never looked at by a garbage collection stays shared with all that is forked
    keepers = {_forked(link, links, limit) for link in links}
    for link in links:
        link.close()
    while keepers:
        keepers.discard(os.wait()[0])
        tree.end_strays(keepers)


def _forked(own: Connection, links: Sequence[Connection], limit: int) -> int:
    """The number of a keeper, in whose process this never returns."""
    process = os.fork()
    if process:
        return process
    try:
        for link in links:
            if link is not own:
                link.close()
        keep(own, limit)
    finally:
        os._exit(0)
