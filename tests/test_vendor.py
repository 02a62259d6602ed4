"""The bundle of third-party scripts: one small file of known versions, with its licences."""

import json
import re
import shutil
import subprocess
import zlib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
STATIC = ROOT / "src" / "pavetwin" / "app" / "static"
SOURCE = ROOT / "assets" / "vendor"
BUNDLE = (STATIC / "vendor.js").read_text(encoding="utf-8")

WHEEL_BYTES = 1_000_000
"""Most bytes that the page may add to the wheel."""


def locked() -> dict[str, dict[str, str]]:
    packages = json.loads((SOURCE / "package-lock.json").read_text(encoding="utf-8"))["packages"]
    return {name.removeprefix("node_modules/"): each for name, each in packages.items() if name}


def test_the_bundle_holds_the_versions_that_are_pinned() -> None:
    asked = json.loads((SOURCE / "package.json").read_text(encoding="utf-8"))["devDependencies"]
    lock = locked()
    assert {name: lock[name]["version"] for name in asked} == asked
    assert all(each["integrity"].startswith("sha512-") for each in lock.values())
    banner = f"three {asked['three']}, uPlot {asked['uplot']}; MIT"
    assert banner in BUNDLE.splitlines()[0]
    assert banner in (STATIC / "vendor.css").read_text(encoding="utf-8")


def test_the_bundle_exports_the_names_that_are_asked_for() -> None:
    source = (SOURCE / "vendor.js").read_text(encoding="utf-8")
    asked = {
        name.split(" as ")[-1].strip()
        for names in re.findall(r"export \{([^}]*)\}", source)
        for name in names.split(",")
        if name.strip()
    }
    (exported,) = re.findall(r"export\{([^}]*)\};?\s*$", BUNDLE)
    assert {name.split(" as ")[-1] for name in exported.split(",")} == asked


def test_the_licences_lie_next_to_the_bundle() -> None:
    text = (STATIC / "vendor-licences.txt").read_text(encoding="utf-8")
    assert text.count("Permission is hereby granted, free of charge") == 2
    assert {"three.js authors", "Leon Sorokin"} <= set(
        re.findall(r"Copyright .* (three\.js authors|Leon Sorokin)", text)
    )


def test_the_bundle_is_small_and_names_no_host() -> None:
    packed = sum(len(zlib.compress(path.read_bytes(), 6)) for path in STATIC.glob("vendor*"))
    assert packed < WHEEL_BYTES / 4
    # The name of a namespace of XML is fetched by nobody.
    assert set(re.findall(r"https?://[\w./-]+", BUNDLE)) <= {"http://www.w3.org/1999/xhtml"}


@pytest.mark.slow
def test_the_same_versions_give_the_same_bytes(tmp_path: Path) -> None:
    if shutil.which("npm") is None:
        pytest.skip("npm is not installed")
    copy = tmp_path / "vendor"
    shutil.copytree(SOURCE, copy, ignore=shutil.ignore_patterns("node_modules"))
    built = subprocess.run([copy / "build.sh", tmp_path / "out"], capture_output=True, text=True, check=False)
    if built.returncode != 0 and re.search("ENOTFOUND|EAI_AGAIN|ECONNREFUSED|network", built.stderr):
        pytest.skip("no package registry answers")
    assert built.returncode == 0, built.stderr
    for path in STATIC.glob("vendor*"):
        assert (tmp_path / "out" / path.name).read_bytes() == path.read_bytes(), path.name
