"""The server's description of itself: OpenAPI, and a page that needs no network."""

from html import escape
from typing import Any, Final

from pavetwin.labels.class_names import CLASS_LABELS
from pavetwin.perception.results import REPLIES
from pavetwin.perception.uploads import FIELD, ServerLimits

_ERRORS: Final = {
    "400": "The form or an image is damaged, there are too many files, or a parameter is not known.",
    "413": "Too many bytes or pixels, or the search takes too long.",
    "415": "No form with files, or a file that is not an image.",
    "429": "Busy: try again in a second.",
}

_CORNERS: Final = {"type": "array", "items": {"type": "array", "items": {"type": "number"}}}
_SHARE: Final = {"type": "number", "minimum": 0, "maximum": 1}
_BOX: Final = {"type": "array", "items": {"type": "number"}, "minItems": 4, "maxItems": 4}

_SCHEMAS: Final[dict[str, Any]] = {
    "Error": {"type": "object", "required": ["error"], "properties": {"error": {"type": "string"}}},
    "Image": {
        "type": "object",
        "required": ["name", "width", "height", "detections"],
        "properties": {
            "name": {"type": "string"},
            "width": {"type": "integer"},
            "height": {"type": "integer"},
            "detections": {"type": "array", "items": {"$ref": "#/components/schemas/Detection"}},
        },
    },
    "Detection": {
        "type": "object",
        "required": ["class", "confidence", "det_conf", "cls_conf", "box"],
        "properties": {
            "class": {"type": "string", "enum": list(CLASS_LABELS)},
            "class_id": {"type": "integer", "minimum": 0, "maximum": len(CLASS_LABELS) - 1},
            "confidence": {**_SHARE, "description": "The final one: det_conf × cls_conf."},
            "det_conf": _SHARE,
            "cls_conf": _SHARE,
            "box": {**_BOX, "description": "Left, top, right, bottom in pixels."},
            "outline": {**_CORNERS, "description": "Corners of the mask in pixels; empty without a mask."},
            "sizes": {"type": "object", "description": "Measured sizes, where the ground resolution is known."},
            "ground": {**_CORNERS, "description": "Longitude and latitude of the box's corners, where known."},
        },
    },
    "RdmoDetection": {
        "type": "object",
        "required": ["clase", "det_conf", "cls_conf", "caja"],
        "properties": {"clase": {"type": "string"}, "det_conf": _SHARE, "cls_conf": _SHARE, "caja": _BOX},
    },
}


def description(version: str, limits: ServerLimits) -> dict[str, Any]:
    """The OpenAPI 3.1 document."""
    of_image = {"$ref": "#/components/schemas/Image"}
    of_rdmo = {"type": "array", "items": {"$ref": "#/components/schemas/RdmoDetection"}}
    image = {"type": "string", "contentMediaType": "application/octet-stream"}
    many = {"type": "array", "items": image, "minItems": 1, "maxItems": limits.batch}
    health = {"200": _content("It is running.", {"type": "object"})}
    one = {"oneOf": [of_image, of_rdmo]}
    all_of_them = {"type": "array", "items": one}
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "PaveTwin detector",
            "version": version,
            "description": f"Defects of pavements, persons and cars in images: at most {limits.upload_mb:g} MB a "
            f"request and {limits.megapixels:g} megapixels an image; JPEG, PNG, WebP, BMP or TIFF.",
        },
        "paths": {
            "/predict": {"post": _predict("predict", "Detections of one image", image, one)},
            "/predict/batch": {
                "post": _predict("predictBatch", "Detections of several images, in their order", many, all_of_them)
            },
            "/health": {"get": {"operationId": "health", "summary": "Whether it is running", "responses": health}},
        },
        "components": {"schemas": _SCHEMAS},
    }


def _predict(name: str, summary: str, file: dict[str, Any], reply: dict[str, Any]) -> dict[str, Any]:
    form = {"type": "object", "required": [FIELD], "properties": {FIELD: file}}
    asked = {"name": "format", "in": "query", "schema": {"type": "string", "enum": list(REPLIES), "default": "json"}}
    error = {"$ref": "#/components/schemas/Error"}
    return {
        "operationId": name,
        "summary": summary,
        "parameters": [asked],
        "requestBody": {"required": True, "content": {"multipart/form-data": {"schema": form}}},
        "responses": {
            "200": _content("Detections, the most confident first.", reply),
            **{status: _content(reason, error) for status, reason in _ERRORS.items()},
        },
    }


def _content(description: str, schema: dict[str, Any]) -> dict[str, Any]:
    return {"description": description, "content": {"application/json": {"schema": schema}}}


def page(document: dict[str, Any]) -> str:
    """The same as HTML, with a form to try it."""
    rows = []
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            answers = "".join(
                f"<li>{status}: {escape(each['description'])}</li>" for status, each in operation["responses"].items()
            )
            asked = "".join(
                f"<p><code>?{each['name']}=</code> {', '.join(each['schema']['enum'])}</p>"
                for each in operation.get("parameters", ())
            )
            rows.append(
                f"<h2><code>{method.upper()} {path}</code></h2><p>{escape(operation['summary'])}.</p>{asked}"
                f"<ul>{answers}</ul>"
            )
    about = document["info"]
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{escape(about["title"])}</title>
<style>body {{ font: 16px/1.5 sans-serif; max-width: 46rem; margin: 2rem auto; padding: 0 1rem; color: #1c1c1c }}
h2 {{ margin: 2rem 0 0; font-size: 1.1rem }} code {{ background: #f0f0f0; padding: .1rem .3rem }}
pre {{ background: #f0f0f0; padding: .6rem; white-space: pre-wrap }}</style></head><body>
<h1>{escape(about["title"])} {escape(about["version"])}</h1><p>{escape(about["description"])}</p>
<form action="/predict" method="post" enctype="multipart/form-data">
<input type="file" name="{FIELD}" accept="image/*" required> <button>Detect</button></form>
<pre>requests.post("http://127.0.0.1:5000/predict", files={{"{FIELD}": open("street.jpg", "rb")}}).json()</pre>
{"".join(rows)}
<p><a href="/openapi.json">openapi.json</a></p></body></html>
"""
