"""Owns the charts of a front: the candidates that no other beats, and how much they dominate the further it went."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from softclose.arrays import FloatArray
from softclose.evaluate.quantities import quantity
from softclose.propose.objectives import sign_of
from softclose_workflows.analyses.front import Front
from softclose_workflows.report.charts import Chart, axis, layout, numbers
from softclose_workflows.report.data import Candidates

TITLES = {
    "v_u": "Upper velocity (cm/s)",
    "p_nc": "Not closed (%)",
    "closing": "Closing time (µs)",
    "peak": "Peak voltage (V)",
}
"""What an axis says of an objective."""


def title(objective: str) -> str:
    """What an axis says of an objective."""
    q = quantity(objective)
    return TITLES.get(objective, f"{q.long_name[:1].upper()}{q.long_name[1:]} ({q.unit})")


_ENDS = {
    "v_u": ("v_u_lower_cm_s", "v_u_upper_cm_s"),
    "p_nc": ("p_nc_wilson_lower", "p_nc_wilson_upper"),
    "closing": ("closing_lower_us", "closing_upper_us"),
}
_MOST_OTHERS = 1500


def front(found: Front, candidates: Candidates) -> Chart:
    """The first objective over the second, a third one as colour; others are small. A click shows the candidate."""
    y, x = found.objectives[:2]
    on = np.array(found.candidates, dtype=np.intp)
    others = np.setdiff1d(np.flatnonzero(np.isfinite(found.values).all(axis=1)), on)[-_MOST_OTHERS:]
    third = found.objectives[2] if len(found.objectives) > 2 else None
    colour: Chart = {"color": "@best"}
    if third is not None:
        colour = {
            "color": numbers(_shown(found, on, third)),
            "colorscale": "Viridis",
            "colorbar": {"title": {"text": title(third), "side": "right"}, "thickness": 12},
        }
    told = "<br>".join(f"{title(name)}: %{{customdata[{k}]}}" for k, name in enumerate(found.objectives, 1))
    traces: list[Chart] = [
        {
            "name": "other candidates",
            "x": numbers(_shown(found, others, x)),
            "y": numbers(_shown(found, others, y)),
            "mode": "markers",
            "marker": {"color": "@unshaped/0.35", "size": 4},
            "customdata": [int(i) for i in others],
            "hovertemplate": "candidate %{customdata}<extra></extra>",
        },
        {
            "name": "the front",
            "x": numbers(_shown(found, on, x)),
            "y": numbers(_shown(found, on, y)),
            "mode": "markers",
            "marker": {"size": 7, **colour},
            "customdata": [
                [int(i), *numbers(np.array([_shown(found, np.array([i]), name)[0] for name in found.objectives]))]
                for i in on
            ],
            "hovertemplate": "candidate %{customdata[0]}<br>" + told + "<extra></extra>",
            **_bars(found, candidates, on, "error_y", y),
            **_bars(found, candidates, on, "error_x", x),
        },
    ]
    spans = {name: _span(_shown(found, on, name)) for name in (x, y)}
    return {
        "data": traces,
        "layout": layout(
            axis(title(x), range=spans[x]),
            axis(title(y), range=spans[y]),
            showlegend=True,
            height=420,
            clickmode="event",
        ),
        "alt": f"{on.size} candidates that no other beats, {title(y)} over {title(x)}.",
    }


def _span(values: FloatArray) -> list[float]:
    """Where an axis begins and ends so that the front fills it: from 0 only where the front comes near to 0."""
    low, high = float(values.min()), float(values.max())
    room = 0.08 * (high - low) or 0.05 * abs(high) or 1.0
    return [-0.5 * room if low < 0.3 * high else low - room, high + room]


def growth(found: Front) -> Chart:
    """Hypervolume of the front over the candidates so far."""
    n, share = np.array(found.growth).T
    return {
        "data": [
            {
                "x": numbers(n, 7),
                "y": numbers(share),
                "mode": "lines+markers",
                "line": {"color": "@best", "width": 2, "shape": "hv"},
                "marker": {"color": "@best", "size": 5},
                "hovertemplate": "%{y:.4f} after %{x} candidates<extra></extra>",
            }
        ],
        "layout": layout(axis("Candidates so far"), axis("Hypervolume (1 = ideal)", rangemode="tozero"), height=300),
        "alt": f"Hypervolume of the front, which grows to {share[-1]:.4f} (1 is ideal).",
    }


def _shown(found: Front, which: NDArray[np.intp], name: str) -> FloatArray:
    """One objective of some candidates, as an axis has it."""
    values = found.values[which, found.objectives.index(name)]
    return np.asarray(values * (100.0 if name == "p_nc" else sign_of(name)))


def _bars(found: Front, candidates: Candidates, on: NDArray[np.intp], which: str, name: str) -> Chart:
    """Intervals of the front's candidates; {} where the objective has none, or none holds."""
    ends = _ENDS.get(name, (f"{name}_lower", f"{name}_upper"))
    if ends[0] not in candidates.columns:
        return {}
    factor = 100.0 if name == "p_nc" else 1.0
    low, high = (factor * candidates.columns[end][on] for end in ends)
    if np.isnan(low).all():
        return {}
    middle = _shown(found, on, name)
    return {
        which: {
            "type": "data",
            "symmetric": False,
            "array": numbers(high - middle),
            "arrayminus": numbers(middle - low),
            "thickness": 1,
            "width": 0,
            "color": "@best/0.5",
        }
    }
