"""One HTML file that plays missions without a server: the page's own modules, styles and layout, with the map, the
tracks and the traffic of the missions inside.

The modules are data URLs that an import map names, so that a browser loads them from a file as well. `inlined.js`
stands in for the module that asks the server. The file asks no host for anything: its Content-Security-Policy forbids
that.
"""

import re
from base64 import b64encode
from collections.abc import Iterator
from json import dumps
from pathlib import Path
from typing import Final

from pavetwin.errors import PaveTwinError

STATIC: Final = Path(__file__).parent / "static"

LARGEST_BYTES: Final = 60_000_000
"""Of a file: larger ones take browsers many seconds to open."""

ENTRY: Final = "replay.js"
INSTEAD: Final = {"server.js": "inlined.js"}
"""Modules that stand in for others where there is no server."""

POLICY: Final = "; ".join(
    (
        "default-src 'none'",
        "script-src 'unsafe-inline' data:",
        "style-src 'unsafe-inline'",
        "img-src data:",
        "base-uri 'none'",
        "form-action 'none'",
    )
)

_IMPORT: Final = re.compile(r"""(\bfrom\s*)(['"])\./([\w.-]+\.js)\2""")
_STYLE: Final = re.compile(r'<link rel="stylesheet" href="static/([\w.-]+)">')
_ICON: Final = re.compile(r'href="static/([\w.-]+\.svg)"')
_SCRIPT: Final = '<script type="module" src="static/main.js"></script>'


def replay_page(played: Path, map_file: Path, name: str) -> bytes:
    """The page of what `write_playback` wrote.

    Args:
        played: its folder.
        map_file: the world's map, gzipped JSON (`pavetwin.app.street_map.packed_map`).
        name: of the missions, for the title.

    Raises:
        PaveTwinError: it would be larger than `LARGEST_BYTES`.
    """
    held = {f"api/played/replay/{path.name}": path for path in sorted(played.glob("*.gz"))} | {"map": map_file}
    files = "\n".join(
        f'<script type="application/gzip" data-file="{place}">{_base64(path.read_bytes())}</script>'
        for place, path in held.items()
    )
    imports = {f"pavetwin/{module}": _url("text/javascript", text) for module, text in _modules()}
    script = (
        f'<script type="importmap">{dumps({"imports": imports})}</script>\n{files}\n'
        f'<script type="module">import "pavetwin/{ENTRY}";</script>'
    )
    page = (STATIC / "index.html").read_text(encoding="utf-8")
    page = _STYLE.sub(lambda found: f"<style>{_text(found[1])}</style>", page)
    page = _ICON.sub(lambda found: f'href="{_url("image/svg+xml", _text(found[1]))}"', page)
    head = (
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        f'<meta name="pavetwin-mission" content="{_escaped(name)}">\n'
        f"<!--\n{_text('vendor-licences.txt')}\n-->"
    )
    page = page.replace('<meta charset="utf-8">', f'<meta charset="utf-8">\n{head}', 1).replace(_SCRIPT, script, 1)
    content = page.encode()
    if len(content) > LARGEST_BYTES:
        raise PaveTwinError(
            f"The page would have {len(content) / 1e6:.0f} MB, and browsers take up to {LARGEST_BYTES / 1e6:.0f} MB "
            "well; fly fewer segments, or traffic on fewer streets (`traffic_area`)."
        )
    return content


def _modules() -> Iterator[tuple[str, str]]:
    """The modules that the page needs, each with its imports named as the import map has them."""
    waiting, known = [ENTRY], {ENTRY}
    while waiting:
        name = waiting.pop()
        text = _text(INSTEAD.get(name, name))
        for found in _IMPORT.finditer(text):
            if found[3] not in known:
                known.add(found[3])
                waiting.append(found[3])
        yield name, _IMPORT.sub(r"\1\2pavetwin/\3\2", text)


def _text(name: str) -> str:
    return (STATIC / name).read_text(encoding="utf-8")


def _url(kind: str, text: str) -> str:
    return f"data:{kind};base64,{_base64(text.encode())}"


def _base64(content: bytes) -> str:
    return b64encode(content).decode()


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
