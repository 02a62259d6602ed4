"""What a browser shows in place of the page where it is refused: one page of its own, since it may fetch nothing."""

from base64 import b64encode
from hashlib import sha256
from html import escape
from typing import Final

_STYLE: Final = (
    ":root{color-scheme:light dark}"
    "body{margin:18vh auto 0;max-width:34rem;padding:0 1.5rem;background:#f4f1eb;color:#23211e;"
    "font:16px/1.5 system-ui,'DejaVu Sans',sans-serif}"
    "h1{font-size:1.3rem;margin:0 0 .6rem}p{margin:0 0 .6rem}"
    "code{padding:1px 5px;border-radius:4px;background:#e5e1d9}"
    "@media(prefers-color-scheme:dark){body{background:#141618;color:#ebe8e3}code{background:#2e3135}}"
)

POLICY: Final = "; ".join(
    (
        "default-src 'none'",
        f"style-src 'sha256-{b64encode(sha256(_STYLE.encode()).digest()).decode()}'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)
"""Its Content-Security-Policy: this one style, and nothing else."""


def refusal_page(words: str) -> str:
    """HTML that says why, and what to do.

    Args:
        words: plain text.
    """
    return f"""<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>PaveTwin</title>
<style>{_STYLE}</style>
<main>
<h1>This page opens from its address</h1>
<p>{escape(words)}</p>
<p>It is in the terminal, in the line “The page is at …”. The token in it lets you in, and this browser keeps it.</p>
<p>Each start has a new token: where <code>pavetwin app</code> was started again, open the new address.</p>
</main>
</html>
"""
