"""Films of a cell: the best and the worst start of its report side by side, as GIF, WebP or MP4; of what was
recorded, or of the stored policy that acts again.

A film shows the pictures of a system that draws itself (`presentation.Drawn`) or of an environment, else the plane that
the task file names, else the signals against time.
"""

import shutil
import subprocess
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from stlbench.contract import Array, GymTask, Integers
from stlbench.contract.presentation import Banded, Drawn, Pixels
from stlbench.errors import UsageError
from stlbench.records.array_files import Which
from stlbench.records.result import MAIN, Result
from stlbench.records.result_files import opened
from stlbench.records.result_files import write as write_file
from stlbench.report.figures import layout, plane
from stlbench.report.figures.files import file_name, save
from stlbench.report.figures.margins import robustness_in_time
from stlbench.report.figures.regions import parts
from stlbench.report.figures.style import TRACE
from stlbench.report.figures.trajectories import READ, part_keys, signals_in_time, trajectories
from stlbench.simulation.referee import Recording, load
from stlbench.study.policies import EVERY, Replay, Start, reenact, replay
from stlbench.task.task import Task, load_task

FRAMES_A_SECOND = 12.5  # GIF counts in hundredths of a second: 8 of them a frame
SHORTEST, LONGEST = 4.0, 12.0  # seconds that a film lasts, whatever the episode does: 150 frames at most
_DPI = 80
_WIDTHS = {1: 7.2, 2: 10.0}  # inches, of one start and of two
_ENTRY = 0.21  # inches of one entry of the legend
_PAUSE = 8  # frames for which the end is held
Update = Callable[[int], None]  # shows the sample of that index
Pictures = Callable[[int], Sequence[Pixels]]
"""A picture of each start at a sample. Called in the order of time."""


class Pace(NamedTuple):
    """Which samples of an episode are shown, and how much faster than real time."""

    samples: Integers
    speed: float


class Scene(NamedTuple):
    figure: Figure
    update: Update
    moving: Sequence[Artist]  # what `update` changes; the rest is drawn once
    remark: str = ""


def pace(steps: int, dt: float) -> Pace:
    """An episode of `steps` steps of `dt` seconds in real time; slower or faster if that is too short or too long."""
    seconds = min(max(steps * dt, SHORTEST), LONGEST)
    count = min(round(seconds * FRAMES_A_SECOND), steps + 1)
    return Pace(np.linspace(0, steps, count).round().astype(np.int64), steps * dt * FRAMES_A_SECOND / count)


def write(
    task: Task,
    recording: Recording,
    robustness: tuple[float, ...],
    title: str,
    path: Path,
    pictures: Pictures | None = None,
) -> str:
    """Write the film of a cell as gif, webp or mp4, as `path` ends; a remark on what is shown, or an empty text.

    The `robustness` is that of each start, as the referee scored it. The `pictures` are of the best and the worst
    start, if no system draws them itself.
    """
    shown = scene(task, recording, robustness, pictures)
    write_video(_frames(task, shown, title), path)
    return shown.remark


def _frames(task: Task, shown: Scene, title: str) -> Iterator[Pixels]:
    figure = shown.figure
    samples, speed = pace(task.file.steps, task.file.sampling_time)
    heading = figure.suptitle(_heading(title, task, 0, speed), fontsize=10)
    figure.draw_without_rendering()  # lays it out
    figure.set_layout_engine("none")
    for artist in (*shown.moving, heading):
        artist.set_animated(True)
    canvas: Any = FigureCanvasAgg(figure)  # its methods have no annotations
    canvas.draw()
    still = canvas.copy_from_bbox(figure.bbox)
    for sample in samples.tolist():
        canvas.restore_region(still)
        shown.update(sample)
        heading.set_text(_heading(title, task, sample, speed))
        for artist in (*shown.moving, heading):
            figure.draw_artist(artist)
        picture: Pixels = np.asarray(canvas.buffer_rgba())[..., :3].copy()
        yield picture
    yield from [picture] * _PAUSE


def _heading(title: str, task: Task, sample: int, speed: float) -> str:
    return f"{title}, {speed:.2g} x real time: {sample * task.file.sampling_time:6.2f} s, step {sample:4d}"


def scene(task: Task, recording: Recording, robustness: tuple[float, ...], pictures: Pictures | None = None) -> Scene:
    """The figure that a film moves: the best start on the left, the worst on the right; a single one alone."""
    chosen = np.array([np.argmax(robustness), np.argmin(robustness)])[: len(robustness)]
    which = ("best start: ", "worst start: ") if len(chosen) > 1 else ("",)
    names = [f"{prefix}robustness {robustness[i]:.3g}" for prefix, i in zip(which, chosen, strict=True)]
    remark = ""
    system = task.dynamics
    if isinstance(system, Drawn) and recording.film is None:
        remark = "no pictures of the system, as the cell's file of traces has no states"
    elif isinstance(system, Drawn) and recording.film is not None:
        states = recording.film.states
        last = states.shape[1] - 1
        hold = task.file.steps // last  # which the cell's track may have changed
        pictures = lambda sample: [system.frame(own[min(sample // hold, last)]) for own in states]  # noqa: E731
    if pictures is not None:
        try:
            return _pictures(pictures, names)
        except RuntimeError as error:
            remark = f"no pictures, {error}"
    drawn = _plane if task.file.plane else _signals
    return drawn(task, recording.traces[chosen], names)._replace(remark=remark)


def _pictures(pictures: Pictures, names: list[str]) -> Scene:
    """Raises `RuntimeError` if there are none of the first sample."""
    first = pictures(0)
    height, width = first[0].shape[:2]
    wide = _WIDTHS[len(names)]
    figure = Figure(figsize=(wide, 0.9 + wide / len(names) * height / width), dpi=_DPI, layout="constrained")
    images = []
    for axes, name, picture in zip(figure.subplots(1, len(names), squeeze=False)[0], names, first, strict=True):
        images.append(axes.imshow(picture))
        axes.set_title(name, fontsize=10)
        axes.set_axis_off()

    def update(sample: int) -> None:
        for image, picture in zip(images, pictures(sample), strict=True):
            image.set_data(picture)

    return Scene(figure, update, images)


def _plane(task: Task, traces: Array, names: list[str]) -> Scene:
    keys, drawn, moving = _ENTRY * len(parts(task)), [], []
    figure = Figure(figsize=(_WIDTHS[len(names)], 5.6 + keys), dpi=_DPI, layout="constrained")
    for axes, trace, name in zip(figure.subplots(1, len(names), squeeze=False)[0], traces, names, strict=True):
        view = plane.lay_out(axes, task, trace[None], whole=True)
        away = ", leaves the picture" if plane.leaving(view, trace[None]).any() else ""
        axes.set_title(name + away, fontsize=10)
        places = trace[:, list(view.columns)]
        axes.plot(*places[0], "o", color="white", markeredgecolor="black", markersize=5, zorder=5)
        (path,) = axes.plot([], [], "-", color=TRACE, linewidth=1.3, zorder=4)
        (head,) = axes.plot([], [], "o", color="black", markersize=6, zorder=6)
        drawn.append((places, path, head))
        regions = plane.moving(axes, task, view)
        moving += [(each, trace) for each in regions.values()]
    shown = _drawn(figure, drawn, part_keys(task, [*view.drawn, *regions]))

    def update(sample: int) -> None:
        for each, own in moving:
            each.show(own[sample])
        shown.update(sample)

    return Scene(figure, update, [*(each.image for each, _ in moving), *shown.moving])


def _signals(task: Task, traces: Array, names: list[str]) -> Scene:
    count, keys = len(task.signals), _ENTRY * (1 + len(parts(task)))
    figure = Figure(figsize=(_WIDTHS[len(names)], 1.4 + 2.2 * count + keys), dpi=_DPI, layout="constrained")
    table = figure.subplots(count, len(names), sharex=True, sharey="row", squeeze=False)
    drawn = []
    for column, trace, name in zip(table.T, traces, names, strict=True):
        shaded = signals_in_time(column, task, trace[None], color=TRACE, linewidth=1.3)
        column[0].set_title(name, fontsize=10)
        for axes, values in zip(column, trace.T, strict=True):
            line, (head,) = axes.lines[0], axes.plot([0], values[:1], "o", color="black", markersize=6, zorder=6)
            drawn.append((np.column_stack([np.arange(len(values)), values]), line, head))
    for row, values, signal in zip(table, np.moveaxis(traces, -1, 0), task.file.signals.values(), strict=True):
        low, high = min(signal.low, values.min()), max(signal.high, values.max())
        margin = 0.04 * (high - low)
        row[0].set_ylim(low - margin, high + margin)
        for axes in row[1:]:
            axes.set_ylabel("")
    read = [layout.patch(READ, label="steps at which the row's signal is read")] if shaded else []
    return _drawn(figure, drawn, [*part_keys(task, shaded), *read])


def _drawn(figure: Figure, lines: Sequence[tuple[Array, Line2D, Line2D]], keys: Sequence[Artist]) -> Scene:
    """Lines that grow along points (T + 1, 2), each with a head; below them the legend."""
    figure.legend(handles=keys, loc="outside lower left", ncols=1, fontsize=9)

    def update(sample: int) -> None:
        for points, line, head in lines:
            line.set_data(*points[: sample + 1].T)
            head.set_data(*points[sample : sample + 1].T)

    return Scene(figure, update, [artist for _, *artists in lines for artist in artists])


def write_video(pictures: Iterable[Pixels], path: Path) -> None:
    """Write pictures (height, width, 3) of one size as a film; the path's ending says as what. Raises `UsageError`."""
    if path.suffix == ".mp4":
        _mp4(pictures, path)
        return
    images = [Image.fromarray(picture) for picture in pictures]  # drawn before the file is there
    settings: dict[str, Any] = {"quality": 60, "method": 3}  # edges are a little soft
    if path.suffix == ".gif":
        # each frame has 256 colours of its own: the first may lack what moves into the picture later
        images, settings = [image.quantize(256) for image in images], {}
    duration = round(1000 / FRAMES_A_SECOND)
    with opened(path) as file:
        images[0].save(
            file, path.suffix[1:], save_all=True, append_images=images[1:], duration=duration, loop=0, **settings
        )


def _mp4(pictures: Iterable[Pixels], path: Path) -> None:
    # its usual encoding wants even sizes
    even = [picture[: len(picture) // 2 * 2, : picture.shape[1] // 2 * 2] for picture in pictures]
    height, width = even[0].shape[:2]
    raw = ("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(FRAMES_A_SECOND), "-i", "-")
    content = np.stack(even).tobytes()
    with TemporaryDirectory(prefix="stlbench-film-") as place:
        film = Path(place, "film.mp4")
        command = [ffmpeg(), "-y", "-loglevel", "error", *raw, "-pix_fmt", "yuv420p", str(film)]
        done = subprocess.run(command, input=content, capture_output=True, check=False)  # noqa: S603
        if done.returncode:
            problem = " ".join(done.stderr.decode(errors="replace").split()) or f"exit code {done.returncode}"
            raise UsageError(f"ffmpeg could not write {path}: {problem}")
        write_file(path, film.read_bytes())


def ffmpeg() -> str:
    """The program that writes mp4. Raises `UsageError` if this machine has none."""
    program = shutil.which("ffmpeg")
    if program is None:
        raise UsageError("mp4 needs the program ffmpeg, which is not on the PATH; --format gif does without")
    return program


Form = Literal["gif", "webp", "mp4", "png"]


class Filmed(NamedTuple):
    paths: tuple[Path, ...]
    remarks: tuple[str, ...]  # a line for each surprise


def film_cell(run: Path, result: Result, which: Which, start: Start, form: Form, out: Path) -> Filmed:
    """Write pictures or a film of a finished cell's policy into the folder `out`.

    Raises `UsageError` if there is nothing to film, or the files cannot be written.
    """
    options: list[str] = [] if which == "selected" else [which]
    if start.point is not None:
        options.append("start-" + ",".join(repr(number).removesuffix(".0") for number in start.point))
    elif start.index is not None:
        options.append(f"start-{start.index}")
    title = ", ".join([result.id.name, *options]).replace("start-", "start ")
    name = file_name(*result.id.name.split("/"), result.id.budget, *options)
    if form == "png":
        return Filmed(tuple(_write_pictures(replay(run, result, which, start), title, out, name)), ())
    recorded = which == "selected" and start == EVERY
    shown = _recorded(run, result) if recorded else replay(run, result, which, start)
    acted, remarks, states = None, list[str](), shown.recording.film
    if isinstance(shown.task.dynamics, GymTask) and states is not None:
        try:
            acted = reenact(run, result, which, start, states)
        except UsageError as error:
            remarks.append(f"no pictures of the environment: {error}")
    path = out / f"film-{name}.{form}"
    remark = write(shown.task, shown.recording, shown.robustness, title, path, acted)
    if remark:
        remarks.append(remark)
    elif acted and states and not acted.repeats(shown.recording.traces[states.starts]):
        remarks.append("the pictures differ from what was recorded: the environment did not repeat it")
    return Filmed((path,), tuple(remarks))


def _recorded(run: Path, result: Result) -> Replay:
    """The traces that were recorded when the cell was trained, which need no policy."""
    task = load_task(result.id.task)
    return Replay(task, None, load(task, result, run), result.measured.selected[MAIN].robustness)


def _write_pictures(shown: Replay, title: str, out: Path, name: str) -> Iterator[Path]:
    bands = shown.method.band() if isinstance(shown.method, Banded) else ()
    yield from save(trajectories(shown.task, shown.recording, title), out, f"trajectories-{name}")
    if figure := robustness_in_time(shown.task, shown.recording, bands, title):
        yield from save(figure, out, f"time-{name}")
