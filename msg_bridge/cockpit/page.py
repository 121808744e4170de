"""The page: where what stands. What moves on it is drawn by static/cockpit.js."""

from __future__ import annotations

from pathlib import Path

from fastapi import FastAPI, WebSocket
from fastapi.staticfiles import StaticFiles
from nicegui import ui

from iolspi_ros.resources import PAINTER
from msg_bridge.cockpit.session import Session
from msg_bridge.cockpit.words import TUNED

STATIC = Path(__file__).parent / "static"
VERDICTS = (
    ("keep", "Keep", "check", "K"),
    ("discard", "Discard", "close", "D"),
    ("undo", "Undo", "undo", "U"),
    ("finish", "Finish", "school", "F"),
)
"""Services of the demonstrator: name, what the button says, its picture, its key."""

SLIDERS = (("speed", "Speed"), ("corruption", "Random actions"))
"""Of `TUNED`, with words for people."""


def make_app(session: Session) -> FastAPI:
    """What a server serves: the page, its files and its socket."""
    app = FastAPI(openapi_url=None)
    app.mount("/cockpit", StaticFiles(directory=STATIC))
    app.mount("/painter", StaticFiles(directory=PAINTER.parent))

    @app.websocket("/socket")
    async def socket(browser: WebSocket) -> None:
        await session.serve(browser)

    ui.run_with(
        app, root=show, title="Cockpit", favicon="🕹️", show_welcome_message=False, tailwind=False,
        reconnect_timeout=10.0,
    )  # fmt: skip
    return app


def show() -> None:
    """Lay the page out."""
    ui.colors(primary="#0b7285", secondary="#8a4b00")
    ui.add_head_html('<link rel="stylesheet" href="/cockpit/cockpit.css">')
    for script in (f"painter/{PAINTER.name}", "cockpit/cockpit.js"):
        ui.add_body_html(f'<script src="/{script}" defer></script>')
    with _part("header", "top"):
        _part("h1", "task").props('aria-live="polite"')
        _part("span", "who")
        _part("span", "link").props('role="status"')
        _part("span", "crowd")
        _button("Take the stick", "sports_esports", "cockpit.toggleStick()", "stick-button")
    with _part("main", "page"):
        with _part("section", "stage", "card"):
            _part("div", "views").props('role="group" aria-label="view"')
            _part("canvas", "vehicle").props('role="img"')
            _part("div", "piloting").props('aria-live="polite"')
            _part("div", "advice").props('aria-live="polite"')
            _part("div", "actions", "flying")
            with _part("div", "hands", "flying"):
                _part("canvas", "pad").props('role="img" aria-label="stick"')
                with _part("div", "beside-pad"):
                    _button(
                        "Take over", "front_hand", "cockpit.toggleTakeover()", "takeover",
                        "secondary",
                    )  # fmt: skip
                    with _part("div", "verdicts"):
                        for service, words, icon, key in VERDICTS:
                            _button(
                                f"{words} ({key})", icon, f'cockpit.call("{service}")',
                                f"verdict-{service}", look="outline",
                            )  # fmt: skip
                    for what, words in SLIDERS:
                        with ui.element("label").classes("slider"):
                            ui.label(words)
                            low, high = TUNED[what]
                            limits = f"type=range min={low} max={high} step=0.05"
                            _part("input", what).props(limits)
                            _part("span", f"{what}-is")
            _part("div", "help")
        with _part("div", "side"):
            _part("section", "numbers", "card")
            with _card("Score of each episode", "score-title"):
                _part("canvas", "scores").props('role="img"')
                _part("div", "scores-key", "key")
            with _part("section", "maps", "card"):
                for name in ("policy", "visits"):
                    with _part("figure", f"{name}-figure"):
                        _part("figcaption", f"{name}-title")
                        _part("canvas", name).props('role="img"')
                _part("div", "policy-key", "key")
            with _card("Nodes", "health-title"):
                _part("ul", "health")
    _part("div", "said").props('role="status" aria-live="polite"')


def _part(tag: str, name: str, classes: str = "") -> ui.element:
    """An element that the script finds by its name."""
    return ui.element(tag).props(f"id={name}").classes(classes)


def _card(title: str, name: str) -> ui.element:
    card = ui.element("section").classes("card")
    with card, _part("h2", name):
        ui.html(title, tag="span", sanitize=False)
    return card


def _button(
    words: str, icon: str, does: str, name: str, colour: str = "primary", look: str = "unelevated"
) -> None:
    button = ui.button(words, icon=icon, color=colour).props(f"id={name} no-caps {look}")
    button.on("click", js_handler=f"(event) => {{ event.currentTarget.blur(); {does} }}")
