# SPDX-License-Identifier: Apache-2.0
"""Reproducible figures as SVG and PNG."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bt_agents_core.errors import BtAgentsError
from bt_agents_lab.experiments.simulated_world import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#999999")
"""Palette for colour-blind readers (Okabe and Ito, 2008)."""

_STYLE: dict[Any, Any] = {
    "svg.hashsalt": "bt-agents",
    "svg.fonttype": "path",
    "path.simplify": True,
    "path.simplify_threshold": 0.3,
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.4,
}
_PNG_DPI = 130

_LAYOUTS = 2
"""Number of layout passes: a layout changes which ticks have labels, and so their size."""


@contextmanager
def sheet(
    folder: Path, name: str, size: tuple[float, float], rows: int = 1, columns: int = 1
) -> Iterator[tuple[Figure, Sequence[Axes]]]:
    """Yield an empty figure of a size [inch] and its axes, row by row.

    Afterwards it is saved as SVG and PNG in a folder, which is made if missing.

    Raises:
        BtAgentsError: matplotlib is not installed, or the files cannot be written.
    """
    try:
        import matplotlib
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure as NewFigure
    except ImportError:
        raise BtAgentsError(
            "figures need matplotlib, which is not installed; install it with "
            "'pip install bt-agents[lab]' or 'apt install python3-matplotlib'"
        ) from None
    with matplotlib.rc_context(_STYLE):
        figure = NewFigure(figsize=size, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(rows, columns, squeeze=False)
        yield figure, list(axes.flat)
        for _ in range(_LAYOUTS):
            figure.draw_without_rendering()
        with writing_into(folder):
            figure.savefig(folder / f"{name}.svg", metadata={"Date": None})
            # One layout serves both.
            figure.set_layout_engine("none")
            figure.savefig(folder / f"{name}.png", dpi=_PNG_DPI, metadata={"Software": None})


@contextmanager
def writing_into(folder: Path) -> Iterator[None]:
    """Make a folder if it is missing, for files to write into it.

    Raises:
        BtAgentsError: It cannot be made, or a file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise BtAgentsError(f"{folder}: {error.strerror}; name a folder to write into") from None


def make_folder(folder: Path) -> None:
    """Make a folder if it is missing, before anything is computed for it.

    Raises:
        BtAgentsError: It cannot be made.
    """
    with writing_into(folder):
        pass


def smooth(values: Floats, rounds: int) -> Floats:
    """Return the means over the last rounds up to each round, for values [..., T]."""
    sums = np.cumsum(values, axis=-1)
    sums = np.concatenate([np.zeros_like(sums[..., :1]), sums], axis=-1)
    ends = np.arange(1, values.shape[-1] + 1)
    starts = np.maximum(ends - rounds, 0)
    return np.asarray((sums[..., ends] - sums[..., starts]) / (ends - starts))


def below(axes: Axes, note: str) -> None:
    """Put the legend below the figure, with a note about lines and bands."""
    axes.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, -0.17 if axes.get_xlabel() else -0.1),
        ncols=3,
        title=note,
        title_fontsize=8,
    )


def band(axes: Axes, runs: Floats, colour: str) -> None:
    """Draw the band of 90 % of the runs [R, T], round by round."""
    if len(runs) < 2:
        return
    low, high = np.quantile(runs, [0.05, 0.95], axis=0)
    rounds = np.arange(1, 1 + runs.shape[1])
    axes.fill_between(rounds, low, high, color=colour, alpha=0.16, linewidth=0)


def share_band(axes: Axes, hits: Floats, colour: str, label: str) -> None:
    """Draw a share of runs round by round with its 95 % interval (normal approximation).

    ``hits`` has one number from 0 to 1 for each run and round, [R, T].
    """
    mean = hits.mean(axis=0)
    error = 1.96 * hits.std(axis=0) / np.sqrt(len(hits))
    rounds = np.arange(1, hits.shape[1] + 1)
    low, high = np.clip([mean - error, mean + error], 0.0, 1.0)
    axes.fill_between(rounds, low, high, color=colour, alpha=0.2, linewidth=0)
    axes.plot(rounds, mean, color=colour, label=label)
