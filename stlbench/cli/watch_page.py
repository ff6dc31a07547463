"""The page of `stlbench watch --page`: a server on this machine that shows a folder of results, and changes nothing."""

from __future__ import annotations

from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Lock
from typing import Any

from stlbench.cli.looker import Looker, View
from stlbench.errors import UsageError
from stlbench.records.result import Result, reported
from stlbench.records.status import ACCIDENTS
from stlbench.report.page.now import Cell, Ended, policy, rendered, require
from stlbench.study.live_cells import Running, duration

_HOST = "127.0.0.1"
_LAST = 20
"""Cells that ended, of which so many are listed."""


def serve(looker: Looker, every: float, port: int, tell: Callable[[str], None]) -> None:
    """Serve the page until ctrl-C. Raises `UsageError` where the port is taken, or jinja2 is not installed."""
    require()
    try:
        server = ThreadingHTTPServer((_HOST, port), handler(looker, every))
    except OSError as error:
        raise UsageError(f"cannot serve on {_HOST}, port {port}: {error.strerror}; leave --port out") from error
    server.daemon_threads = True
    tell(f"http://{_HOST}:{server.server_port}/ shows {looker.folder}/; ctrl-C ends it")
    try:
        server.serve_forever(poll_interval=0.2)
    except KeyboardInterrupt:
        tell("ended")
    finally:
        server.server_close()


def handler(looker: Looker, every: float) -> type[BaseHTTPRequestHandler]:
    """What answers requests. Only this machine's own names are answered, so that no other site can read the page."""
    guard = Lock()

    class Page(BaseHTTPRequestHandler):
        server_version, sys_version = "stlbench", ""

        def do_GET(self) -> None:
            name = (self.headers.get("Host") or "").partition(":")[0]
            if name not in (_HOST, "localhost"):
                self.send_error(403, "only 127.0.0.1 and localhost are answered")
            elif self.path != "/":
                self.send_error(404, "there is one page: /")
            else:
                with guard:
                    text = page_of(looker.look(), str(looker.folder), every)
                self._answer(text.encode())

        def _answer(self, content: bytes) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("Content-Security-Policy", policy())
            self.send_header("X-Content-Type-Options", "nosniff")
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, format: str, *args: Any) -> None: ...

    return Page


def page_of(view: View, folder: str, every: float) -> str:
    """The page as text."""
    ended = list(view.results)[::-1]
    return rendered(
        folder=folder,
        every=every,
        counts=view.counts,
        done=len(view.results),
        total=view.total,
        writer=view.writer,
        most=_LAST,
        cells=[_cell(one, view.now) for one in view.running],
        failed=[_ended(each) for each in ended if each.status in ACCIDENTS][:_LAST],
        ended=[_ended(each) for each in ended if each.status not in ACCIDENTS][:_LAST],
    )


def _cell(one: Running, now: float) -> Cell:
    steps = f"{one.steps:,} of {one.of:,}" if one.share < 1 else "trained, is scored"
    satisfied = "" if one.satisfaction is None else f"{100 * one.satisfaction:.0f} %"
    robustness = "" if one.robustness is None else f"{one.robustness:.3f}"
    return Cell(one.name, one.share, steps, duration(max(0.0, now - one.began)), satisfied, robustness, one.curve)


def _ended(result: Result) -> Ended:
    if result.measurement is None:
        return Ended(result.id.name, result.status, result.reason, "", "", "")
    score, took = reported(result.measurement.selected), duration(result.measurement.wall_seconds)
    return Ended(result.id.name, result.status, "", f"{100 * score.satisfaction:.0f} %", f"{score.mean:.3f}", took)
