"""Without a Vulkan adapter frames are refused in one plain line, and everything that needs none goes on."""

import os
import subprocess
import sys
from pathlib import Path

NOWHERE = {"VK_ICD_FILENAMES": "/nowhere.json", "VK_DRIVER_FILES": "/nowhere.json"}
TESTS = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])


def without_an_adapter(program: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", program, *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, env={**os.environ, **NOWHERE, "PYTHONPATH": TESTS}
    )


def test_a_renderer_names_the_package_that_is_missing() -> None:
    done = without_an_adapter(
        "from pavetwin.errors import PaveTwinError\n"
        "from pavetwin.render.renderer import Renderer\n"
        "from scenes.stage import Plane\n"
        "try:\n    Renderer(Plane())\nexcept PaveTwinError as error:\n    print(error)\n"
    )
    assert done.stdout.count("\n") == 1
    assert "mesa-vulkan-drivers" in done.stdout


def test_worlds_are_built_and_exported_all_the_same(tmp_path: Path) -> None:
    main = "from pavetwin.cli import main; main()"
    built = without_an_adapter(main, "world", "build", "--generate", "grid", "--seed", "1", "-o", tmp_path / "world")
    assert built.returncode == 0, built.stderr
    exported = without_an_adapter(
        main, "world", "export", tmp_path / "world", tmp_path / "part.glb", "--bounds", "100,100,140,140"
    )
    assert exported.returncode == 0, exported.stderr
    assert (tmp_path / "part.glb").read_bytes()[:4] == b"glTF"


def test_who_asks_again_is_told_the_same() -> None:
    """A failure is not remembered, and must not change what is said the second time."""
    script = """
from pavetwin.errors import PaveTwinError
from pavetwin.render.adapter import find_adapter
for _ in range(2):
    try:
        find_adapter()
    except PaveTwinError as error:
        print(error)
"""
    nowhere = {**os.environ, "VK_ICD_FILENAMES": "/nowhere", "VK_DRIVER_FILES": "/nowhere"}
    done = subprocess.run([sys.executable, "-c", script], env=nowhere, capture_output=True, text=True, check=True)
    first, second = done.stdout.splitlines()
    assert first == second
    assert "mesa-vulkan-drivers" in first
