"""Matplotlib's SVG in fewer bytes: the same picture without unused ids, blanks and digits."""

import re
from typing import Final

_DIGITS: Final = re.compile(r"-?\d+\.\d{3,}")
_REFERENCE: Final = re.compile(r'(?:href="|url\()#([\w-]+)')
_PATH: Final = re.compile(r' d="([^"]*)"')
_PLACE: Final = re.compile(r' [xy]="[^"]*"')
_BESIDE_LETTER: Final = re.compile(r" ?([A-Za-z]) ?")
_LINES: Final = re.compile(r"L[^A-Za-z]+(?:L[^A-Za-z]+)+")
_STYLE: Final = re.compile(r' style="[^"]*"')
_AFTER_SIGN: Final = re.compile(r"([:;]) ")
_ONE_IN_GROUP: Final = re.compile(r"<g>(<[^<>]*/>)</g>")


def slim(svg: str) -> str:
    """Only the `svg` element, on one line. Coordinates keep hundredths of a point."""
    body = re.sub(r"<!--.*?-->|<metadata>.*?</metadata>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    body = re.sub(r">\s+<", "><", re.sub(r"\s*\n\s*", " ", body)).strip()
    body = _PATH.sub(lambda path: f' d="{_path(path[1])}"', body)
    body = _PLACE.sub(lambda place: _rounded(place[0]), body)
    body = _STYLE.sub(lambda style: _AFTER_SIGN.sub(r"\1", style[0]), body)
    body = _named(body.replace("xlink:href", "href"))
    while (shorter := _ONE_IN_GROUP.sub(r"\1", body)) != body:
        body = shorter
    return body


def _named(body: str) -> str:
    """Only referenced elements keep an id, a short one."""
    short = {name: f"n{at}" for at, name in enumerate(dict.fromkeys(_REFERENCE.findall(body)))}
    body = _REFERENCE.sub(lambda found: found[0].replace(found[1], short[found[1]]), body)
    return re.sub(r' id="([^"]*)"', lambda name: f' id="{short[name[1]]}"' if name[1] in short else "", body)


def _path(data: str) -> str:
    """Path data without blanks beside letters, and with the letter of lines that follow each other written once."""
    tight = _BESIDE_LETTER.sub(r"\1", _rounded(data))
    return _LINES.sub(lambda lines: "L" + lines[0][1:].replace("L", " "), tight)


def _rounded(text: str) -> str:
    return _DIGITS.sub(lambda number: f"{float(number[0]):.2f}".rstrip("0").rstrip("."), text)
