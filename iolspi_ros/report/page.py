"""The page of a run: one HTML file with everything in it."""

from __future__ import annotations

import base64
import html
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from iolspi_ros.core.checkpoint import atomic_file

Array = NDArray[np.float64]

_STYLE = """
body{font:16px/1.5 system-ui,sans-serif;color:#1f2933;max-width:60rem;
 margin:2rem auto;padding:0 1rem}
h1{font-size:1.6rem;margin-bottom:.2rem}h2{font-size:1.1rem;margin-top:2.2rem}
p.lead{color:#52606d;margin-top:0}img{width:100%;height:auto}
.facts{display:grid;grid-template-columns:repeat(auto-fit,minmax(11rem,1fr));
 gap:.8rem;margin:1.2rem 0}
.fact{background:#f1f3f5;border-radius:.5rem;padding:.7rem 1rem}
.fact b{display:block;font-size:1.4rem}.fact span{color:#52606d;font-size:.85rem}
table{border-collapse:collapse;font-size:.9rem}td{padding:.1rem .8rem .1rem 0;vertical-align:top}
canvas{background:#f8f9fa;border-radius:.5rem;display:block}p.say{color:#52606d;margin:.2rem 0}
"""

_SWING = """
<h2>The last episode, as the graph flew it</h2>
<canvas id="swing" width="260" height="260" role="img"
 aria-label="animation of the pendulum"></canvas><p class=say id="clock"></p>
<script>
const a=ANGLES, dt=DT, c=document.getElementById('swing').getContext('2d');
const start=performance.now();
function draw(now){
 const t=((now-start)/1000*0.5)%(a.length*dt+0.7), k=Math.min(Math.floor(t/dt),a.length-1);
 const x=130+95*Math.sin(a[k]), y=130-95*Math.cos(a[k]);
 c.clearRect(0,0,260,260);c.lineWidth=6;c.lineCap='round';c.strokeStyle='#1f2933';
 c.beginPath();c.moveTo(130,130);c.lineTo(x,y);c.stroke();
 c.fillStyle='#0b7285';c.beginPath();c.arc(x,y,16,0,7);c.fill();
 document.getElementById('clock').textContent=(k*dt).toFixed(2)+' s, at half speed';
 requestAnimationFrame(draw)}
requestAnimationFrame(draw)
</script>
"""


class Part(NamedTuple):
    """A figure under its heading, with a sentence on how to read it; or ready HTML."""

    heading: str
    content: Figure | str
    says: str = ""


def swing(states: Array, dt: float) -> str:
    """Animation of a pendulum's episode, angle zero upright."""
    angles = [round(float(state[0]), 3) for state in states]
    return _SWING.replace("ANGLES", json.dumps(angles)).replace("DT", repr(dt))


def write(
    path: Path,
    title: str,
    lead: str,
    facts: Sequence[tuple[str, str]],
    parts: Sequence[Part],
    summary: dict[str, Any],
) -> None:
    """Write the page.

    Parameters
    ----------
    path : Path
    title, lead : str
    facts : sequence of (str, str)
        Big number and what it is.
    parts : sequence of Part
    summary : dict
        Shown as a table at the end.
    """
    boxes = "".join(
        f"<div class=fact><b>{html.escape(value)}</b><span>{html.escape(name)}</span></div>"
        for value, name in facts
    )
    rows = "".join(
        f"<tr><td>{html.escape(name.replace('_', ' '))}<td>{html.escape(_short(value))}"
        for name, value in summary.items()
    )
    body = "".join(map(_part, parts))
    page = (
        f"<!doctype html><html lang=en><meta charset=utf-8>"
        f"<meta name=viewport content='width=device-width'><title>{html.escape(title)}</title>"
        f"<style>{_STYLE}</style><h1>{html.escape(title)}</h1>"
        f"<p class=lead>{html.escape(lead)}</p><div class=facts>{boxes}</div>{body}"
        f"<h2>In numbers</h2><table>{rows}</table></html>"
    )
    with atomic_file(path) as file:
        file.write(page.encode())


def _short(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _part(part: Part) -> str:
    if isinstance(part.content, str):
        return part.content
    buffer = io.BytesIO()
    part.content.savefig(buffer, format="png", dpi=120)
    picture = base64.b64encode(buffer.getvalue()).decode()
    text = html.escape(part.heading)
    says = f"<p class=say>{html.escape(part.says)}</p>"
    return f"<h2>{text}</h2>{says}<img alt='{text}' src='data:image/png;base64,{picture}'>"
