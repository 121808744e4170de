"""The page of a run: one HTML file with everything in it."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from iolspi_ros import figures
from iolspi_ros.folders import atomic_file
from iolspi_ros.resources import PAINTER
from sim_nodes.tasks.shapes import Picture

_STYLE = """
body{font:16px/1.5 system-ui,sans-serif;color:#1f2933;max-width:60rem;
 margin:2rem auto;padding:0 1rem}
h1{font-size:1.6rem;margin-bottom:.2rem}h2{font-size:1.1rem;margin:0 0 .2rem}
p.lead{color:#52606d;margin-top:0}img,canvas{max-width:100%;height:auto}
.facts{display:grid;grid-template-columns:repeat(auto-fit,minmax(9rem,1fr));
 gap:.8rem;margin:1.2rem 0}
.fact{background:#f1f3f5;border-radius:.5rem;padding:.7rem 1rem}
.fact b{display:block;font-size:1.4rem}.fact span{color:#52606d;font-size:.9rem}
.parts{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,22rem),1fr));
 gap:2.2rem 1.6rem;margin-top:2rem}
.parts>section{min-width:0}.wide{grid-column:1/-1}
table{border-collapse:collapse;font-size:.9rem}
td,th{padding:.1rem .8rem .1rem 0;vertical-align:top;overflow-wrap:anywhere;text-align:left}
.scroll{overflow-x:auto}.scroll td,.scroll th{overflow-wrap:normal;min-width:4.5rem}
canvas{background:#f8f9fa;border-radius:.5rem;display:block}
#views button{font:inherit;font-size:.9rem;margin:.3rem .4rem .3rem 0;padding:.2rem .8rem;
 border:1px solid #cbd2d9;border-radius:2rem;background:#fff;color:inherit;cursor:pointer}
#views button[aria-pressed=true]{background:#0b7285;color:#fff}p.say{color:#52606d;margin:.2rem 0}
"""

_FILM = """
<h2>HEADING</h2>
<div id="views" role="group" aria-label="view"></div>
<canvas id="film" role="img" aria-label="ALT"></canvas>
<p class=say id="clock"></p>
<script>
PAINTER
const f=FILM, canvas=document.getElementById('film'), c=canvas.getContext('2d');
canvas.width=720; canvas.height=f.deep?420:320;
const views=f.deep?Object.keys(space.VIEWS):['side'], buttons=document.getElementById('views');
let from=views[0], which=0, begun=performance.now();
if(f.deep) for(const name of views){const b=document.createElement('button'); b.textContent=name;
 b.onclick=()=>{from=name}; buttons.append(b)}
const pause=0.7;
function draw(now){
 let frames=f.episodes[which], t=Math.max(now-begun,0)/1000*f.speed;
 if(t>(frames.length-1)*f.dt+pause*f.speed){
  which=(which+1)%f.episodes.length; frames=f.episodes[which]; begun=now; t=0}
 const at=Math.min(t/f.dt,frames.length-1), k=Math.floor(at), u=at-k, next=frames[Math.min(k+1,
  frames.length-1)];
 const shapes=f.shapes.map((s,i)=>({...s, points:frames[k][i].map((p,j)=>
  p.map((v,d)=>v+u*(next[i][j][d]-v)))}));
 const vehicle=shapes.find(s=>s.name=='vehicle'), w=canvas.width, h=canvas.height;
 c.clearRect(0,0,w,h);
 space.paint(c,shapes,space.VIEWS[from](vehicle?vehicle.points[0]:[0,0,0],f.seen,w,h),
  from=='on board'?'vehicle':'');
 for(const b of buttons.children) b.setAttribute('aria-pressed',b.textContent==from);
 document.getElementById('clock').textContent=(at*f.dt).toFixed(2)+' s of episode '+(which+1)+
  ' of '+f.episodes.length+f.ends[which]+', SPEED';
 requestAnimationFrame(draw)}
requestAnimationFrame(draw)
</script>
"""


_ELSEWHERE = ("task_description",)
"""What the summary has and the page's table has not."""


class Part(NamedTuple):
    """A figure under its heading, with a sentence on how to read it; or ready HTML."""

    heading: str
    content: Figure | str
    says: str = ""


def animation(
    heading: str, films: Sequence[Sequence[Picture]], ends: Sequence[str], dt: float
) -> str:
    """Episodes one after the other, as pictures `dt` seconds apart, and how each ended."""
    step = max(1, round(0.02 / dt))  # closer ones are only more to load
    films = [frames[::step] for frames in films]
    points = np.array([p for frames in films for seen in frames for s in seen for p in s.points])
    speed = 0.5 if len(films[0]) * step * dt < 2.0 else 1.0
    content = {
        "dt": step * dt,
        "speed": speed,
        "ends": [f" ({end})" if end else "" for end in ends],
        "deep": bool(np.abs(points[:, 1]).max() > 1e-6),
        "seen": np.stack([points.min(axis=0), points.max(axis=0)], axis=1).round(4).tolist(),
        "shapes": [
            {"name": s.name, "kind": s.kind, "size": s.size,
             "colour": [*(round(255 * v) for v in s.colour[:3]), s.colour[3]]}
            for s in films[0][0]
        ],
        "episodes": [
            [[[[round(v, 4) for v in point] for point in s.points] for s in seen]
             for seen in frames]
            for frames in films
        ],
    }  # fmt: skip
    told = ", ".join(end for end in ends if end)
    alt = f"animation of {len(films)} episodes" + (f": {told}" if told else "")
    page = _FILM.replace("HEADING", html.escape(heading)).replace("ALT", html.escape(alt))
    page = page.replace("SPEED", "in real time" if speed == 1.0 else "at half speed")
    page = page.replace("FILM", json.dumps(content, separators=(",", ":")))
    return page.replace("PAINTER", PAINTER.read_text(encoding="utf-8"))


def write(
    path: Path,
    title: str,
    lead: str,
    facts: Sequence[tuple[str, str]],
    note: str,
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
    note : str
        How these numbers go together, where they seem not to.
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
        if name not in _ELSEWHERE
    )
    body = "".join(map(_part, parts))
    page = (
        f"<!doctype html><html lang=en><meta charset=utf-8>"
        f"<meta name=viewport content='width=device-width'><title>{html.escape(title)}</title>"
        f"<style>{_STYLE}</style><h1>{html.escape(title)}</h1>"
        f"<p class=lead>{html.escape(lead)}</p><div class=facts>{boxes}</div>"
        + (f"<p class=note>{html.escape(note)}</p>" if note else "")
        + f"<div class=parts>{body}<section class=wide><h2>In numbers</h2><table>{rows}</table>"
        "<p class=say>summary.json has them all, and the description of the task.</p></section>"
        "</div></html>"
    )
    with atomic_file(path) as file:
        file.write(page.encode())


def _short(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_short(part)}" for name, part in value.items())
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _part(part: Part) -> str:
    if isinstance(part.content, str):
        return f"<section class=wide>{part.content}</section>"
    picture = base64.b64encode(figures.png(part.content)).decode()
    says = f"<p class=say>{html.escape(part.says)}</p>"
    alt = html.escape(f"{part.heading}. {figures.alt(part.content)}")
    return (
        f"<section><h2>{html.escape(part.heading)}</h2>{says}"
        f"<img alt='{alt}' src='data:image/png;base64,{picture}'></section>"
    )
