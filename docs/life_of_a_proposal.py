"""Draws the life of a proposal for docs/explanation/search.md, as plain SVG.

python docs/life_of_a_proposal.py rewrites docs/_static/life-of-a-proposal.svg
"""

from __future__ import annotations

from html import escape
from pathlib import Path

TARGET = Path(__file__).parent / "_static" / "life-of-a-proposal.svg"
INK, LINE, PAPER, DRIVER, WORKERS, STORE = "#222222", "#666666", "#ffffff", "#e4eef2", "#f6e9dc", "#ececec"


def box(x: int, y: int, width: int, height: int, fill: str, title: str, *lines: str) -> list[str]:
    """A step: its name, and what is said about it."""
    middle = x + width // 2
    out = [f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="6" fill="{fill}" stroke="{LINE}"/>']
    out.append(f'<text x="{middle}" y="{y + 24}" font-weight="bold">{escape(title)}</text>')
    return out + [f'<text x="{middle}" y="{y + 26 + 18 * i}">{escape(line)}</text>' for i, line in enumerate(lines, 1)]


def arrow(path: str, label: str = "", at: tuple[int, int] = (0, 0)) -> list[str]:
    """A line with a head, and a word beside it."""
    out = [f'<path d="{path}" fill="none" stroke="{LINE}" stroke-width="1.5" marker-end="url(#head)"/>']
    return out + ([f'<text x="{at[0]}" y="{at[1]}" font-style="italic">{escape(label)}</text>'] if label else [])


def draw() -> str:
    """The whole picture."""
    parts = [
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 860 350" font-family="sans-serif" font-size="12" '
        f'text-anchor="middle" fill="{INK}">',
        '<defs><marker id="head" markerWidth="9" markerHeight="8" refX="8" refY="4" orient="auto">'
        f'<path d="M0 0 L9 4 L0 8 z" fill="{LINE}"/></marker></defs>',
        f'<rect width="860" height="350" rx="8" fill="{PAPER}"/>',
        *box(20, 30, 150, 84, DRIVER, "plan", "wave w: stage, size,", "switches, sees"),
        *box(240, 30, 170, 84, DRIVER, "propose", "engine, once a wave:", "a pure function"),
        *box(480, 30, 150, 84, DRIVER, "check", "not admissible, failed:", "a recorded fallback"),
        *box(700, 30, 140, 84, DRIVER, "cut", "blocks: candidates", "by switches"),
        *box(700, 176, 140, 84, WORKERS, "simulate", "blocks, in any order;", "each with its digests"),
        *box(480, 176, 150, 84, DRIVER, "assess", "g, v_u, p_nc, intervals", "of each candidate"),
        *box(240, 176, 170, 84, DRIVER, "commit", "records, then the root:", "whole waves, in order"),
        *box(20, 176, 150, 84, STORE, "records", "of the committed", "waves"),
        *arrow("M170 72 H238"),
        *arrow("M410 72 H478", "waveforms", (444, 64)),
        *arrow("M630 72 H698"),
        *arrow("M770 114 V174"),
        *arrow("M700 218 H632", "V, closed", (666, 210)),
        *arrow("M480 218 H412"),
        *arrow("M240 218 H172"),
        *arrow("M95 176 V145 H290 V116", "history: waves 0 … sees − 1", (192, 139)),
        *arrow("M555 114 V145 H360 V116", "pending: waveforms of waves sees … w − 1", (480, 163)),
        *box(20, 310, 20, 20, DRIVER, ""),
        '<text x="48" y="325" text-anchor="start">in the driver</text>',
        *box(180, 310, 20, 20, WORKERS, ""),
        '<text x="208" y="325" text-anchor="start">on the workers</text>',
        *box(340, 310, 20, 20, STORE, ""),
        '<text x="368" y="325" text-anchor="start">in the store: after a kill it begins here again</text>',
        "</svg>",
    ]
    return "\n".join(part for part in parts if not part.endswith("></text>")) + "\n"


if __name__ == "__main__":
    TARGET.write_text(draw(), encoding="utf-8")
