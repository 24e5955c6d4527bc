"""Figures of results; matplotlib is needed only here."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import matplotlib.figure

    from .studies import Study


def _pyplot() -> Any:
    try:
        import matplotlib.pyplot as plt
    except ImportError as missing:
        raise ImportError("figures need matplotlib: pip install deadtime[plot]") from missing
    return plt


# --- studies


def plot_study(study: Study) -> matplotlib.figure.Figure:
    """RMS error by method beside the bound, and coverage of the 95 % intervals: a point per cell, a bar at the median."""
    plt = _pyplot()
    groups: dict[str, list[dict[str, Any]]] = {}
    for cell in study.cells:
        options = "".join(f" {key}={value}" for key, value in cell["options"].items())
        groups.setdefault(cell["method"] + options, []).append(cell)
    names = list(groups)
    figure, axes = plt.subplots(1, 2, figsize=(11, 1.6 + 0.28 * len(names)), sharey=True, layout="constrained")
    # Without error at all there is no place on a logarithmic axis.
    seen = [c["rms_samples"] for c in study.cells if c["rms_samples"]]
    least = min(seen, default=1.0) / 2
    for row, name in enumerate(names):
        cells = groups[name]
        rms = [max(c["rms_samples"], least) for c in cells if c["rms_samples"] is not None]
        bounds = [c["bound_rms_samples"] for c in cells if c["bound_rms_samples"]]
        held = [100 * c["coverage95"] for c in cells if c["coverage95"] is not None]
        axes[0].plot(rms, [row] * len(rms), "o", color="C0", alpha=0.5, label="RMS error" if row == 0 else None)
        axes[0].plot(bounds, [row] * len(bounds), "|", color="C3", markersize=12, label="Cramér-Rao bound" if row == 0 else None)
        for axis, values in ((axes[0], rms), (axes[1], held)):
            if values:
                axis.plot([sorted(values)[len(values) // 2]], [row], "D", color="black", markersize=5)
        axes[1].plot(held, [row] * len(held), "o", color="C0", alpha=0.5)
    axes[0].set(xscale="log", xlabel="RMS error, samples (diamond: median of the cells)", yticks=range(len(names)), yticklabels=names)
    axes[0].invert_yaxis()
    axes[0].legend(loc="best")
    axes[1].axvline(95, color="C2", linestyle="--")
    axes[1].set(xlim=(-3, 103), xlabel="truth inside the 95 % interval, %")
    figure.suptitle(f"{study.name}, seed {study.seed}")
    return figure
