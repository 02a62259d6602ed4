"""The rules of the house, read from the source itself: who imports whom, what stays light, how large a file may be."""

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "src" / "pavetwin"

# From the ground up. A room imports from strictly lower layers, or from itself.
LAYERS: tuple[frozenset[str], ...] = (
    frozenset({"errors", "arrays"}),
    frozenset({"_core", "seeds", "files", "geo_files", "memory", "registry", "workers", "listening"}),
    frozenset({"plugins"}),
    frozenset({"config"}),
    frozenset({"world", "uav"}),
    frozenset({"traffic", "navigation", "defects"}),
    frozenset({"twin", "scene", "labels", "pci"}),
    frozenset({"detections"}),
    frozenset({"render", "perception"}),
    frozenset({"policies", "sensing"}),
    frozenset({"mission"}),
    frozenset({"draw"}),
    frozenset({"inventory", "reports"}),
    frozenset({"experiments", "capture", "flightplan"}),
    frozenset({"handover", "driving", "training"}),
    frozenset({"app"}),
    frozenset({"cli"}),
)
LEVEL = {room: level for level, rooms in enumerate(LAYERS) for room in rooms}

# The front door may open any room; `python -m pavetwin` starts the command line.
DOORS = {"__init__", "__main__"}

# What a mission without pictures never loads: drawing, learning, the web, the command line, SUMO, many machines.
HEAVY = frozenset(
    {
        *("matplotlib", "pygfx", "wgpu", "bpy", "cv2"),
        "pandas",
        *("torch", "torchvision", "ultralytics", "onnxruntime", "supervision", "albumentations"),
        *("fastapi", "starlette", "uvicorn", "flask", "tornado", "typer"),
        *("sumo", "sumolib", "libsumo", "traci"),
        *("dask", "distributed", "statsmodels"),
    }
)

MAX_LINES = 800

# An option of ours within a text. A whole literal (`--net-file=…`) is an argument for a program that we start.
OPTION = re.compile(r"(?:^|[\s(`])(?:--[a-z]|-[a-zA-Z](?=[\s`.,;:)]|$))")

# Written in two halves, so that this file does not name them either.
REGISTRY_HOSTS = tuple(
    ".".join(halves)
    for halves in (
        ("pypi", "org"),
        ("pythonhosted", "org"),
        ("crates", "io"),
        ("npmjs", "org"),
        ("npmjs", "com"),
        ("proxy.golang", "org"),
        ("repo1.maven", "org"),
        ("deb.debian", "org"),
    )
)
# How Cargo.lock spells "the usual registry": a name in its file format, fixed by Cargo.
CARGO_SOURCE = "registry+https://github.com/rust-lang/" + ".".join(("crates", "io-index"))


def room_of(path: Path, package: Path) -> str:
    return path.relative_to(package).parts[0].removesuffix(".pyi").removesuffix(".py")


def imported_rooms(path: Path, package: Path) -> Iterator[tuple[int, str]]:
    """Line and room of every import of the package's own, at the top, in a function, or for the type checker alone.

    A name taken from the front door itself is given as `pavetwin`; its dunders (`__version__`) are anyone's.
    """
    inside = (package.name, *path.relative_to(package).parent.parts)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), str(path))):
        if isinstance(node, ast.Import):
            targets = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = inside[: len(inside) - node.level + 1] if node.level else ()
            origin = ".".join((*base, *((node.module,) if node.module else ())))
            targets = [f"{origin}.{alias.name}" for alias in node.names] if origin == package.name else [origin]
        else:
            continue
        for target in targets:
            head, _, rest = target.partition(".")
            name = rest.partition(".")[0]
            if head != package.name or (name.startswith("__") and name.endswith("__")):
                continue
            is_room = name in LEVEL or (package / name).is_dir() or (package / f"{name}.py").is_file()
            yield node.lineno, name if name and is_room else package.name


def broken_import_rules(package: Path) -> list[str]:
    """One line for each arrow that points up or sideways, and for each room that has no place in `LAYERS`."""
    broken = []
    for path in sorted([*package.rglob("*.py"), *package.rglob("*.pyi")]):
        room, where = room_of(path, package), path.relative_to(package.parent)
        if room in DOORS:
            continue
        if room not in LEVEL:
            broken.append(f"{where}: the room '{room}' has no layer; give it one in the design and in LAYERS")
            continue
        for line, other in imported_rooms(path, package):
            if other == package.name:
                broken.append(f"{where}:{line}: '{room}' imports from the front door; import from the room itself")
            elif other not in LEVEL:
                broken.append(f"{where}:{line}: '{room}' imports '{other}', which has no layer")
            elif other != room and LEVEL[other] >= LEVEL[room]:
                broken.append(f"{where}:{line}: '{room}' imports '{other}', which is not below it")
    return broken


def tracked_files() -> list[Path]:
    """The project's files as git sees them, new ones included and ignored ones not."""
    listing = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=False,
    )
    if listing.returncode != 0:
        pytest.skip(f"git cannot list the project's files: {listing.stderr.decode().strip()}")
    paths = (ROOT / name for name in listing.stdout.decode().split("\0") if name)
    return [path for path in paths if path.is_file()]


def test_imports_point_down() -> None:
    assert broken_import_rules(PACKAGE) == []


def test_only_commands_import_training() -> None:
    paths = [path for path in PACKAGE.rglob("*.py") if room_of(path, PACKAGE) not in {"training", "cli"}]
    importing = [path for path in paths if "training" in {room for _, room in imported_rooms(path, PACKAGE)}]
    assert [str(path.relative_to(PACKAGE)) for path in importing] == []


@pytest.mark.parametrize(
    ("room", "line", "complaint"),
    [
        ("mission", "from pavetwin.twin import State", None),
        ("mission", "from pavetwin.mission.planning import plan", None),
        ("mission", "from .plan import plan", None),
        ("mission", "from pavetwin import __version__", None),
        ("mission", "from pavetwin.draw import draw_map", "not below"),
        ("twin", "from ..mission import run", "not below"),
        ("twin", "from .. import mission", "not below"),
        ("world", "def late():\n    from pavetwin import traffic", "not below"),
        ("twin", "from pavetwin import fly", "front door"),
        ("attic", "import numpy", "no layer"),
        ("cli", "from pavetwin.attic import box", "no layer"),
    ],
)
def test_the_rule_catches_what_it_should(tmp_path: Path, room: str, line: str, complaint: str | None) -> None:
    package = tmp_path / "pavetwin"
    for name in {"attic", room} if complaint == "no layer" else {room}:
        (package / name).mkdir(parents=True)
    (package / room / "module.py").write_text(line + "\n", encoding="utf-8")
    broken = broken_import_rules(package)
    if complaint is None:
        assert broken == []
    else:
        assert len(broken) == 1, broken
        assert complaint in broken[0]


def test_the_process_of_the_simulation_loads_what_it_needs() -> None:
    script = "import pavetwin.traffic.sumo_run, sys; print(*sorted({name.partition('.')[0] for name in sys.modules}))"
    fresh = subprocess.run([sys.executable, "-I", "-c", script], capture_output=True, text=True, check=True)
    needless = {"pydantic", "yaml", "shapely", "pyproj", "scipy", "polars", "pyarrow"}
    assert sorted(needless & set(fresh.stdout.split())) == []


@pytest.mark.parametrize("module", ["pavetwin", "pavetwin.mission"])
def test_a_headless_mission_loads_nothing_heavy(module: str) -> None:
    script = f"import {module}, sys; print(*sorted({{name.partition('.')[0] for name in sys.modules}}))"
    fresh = subprocess.run([sys.executable, "-I", "-c", script], capture_output=True, text=True, check=False)
    assert fresh.returncode == 0, fresh.stderr
    loaded = fresh.stdout.split()
    assert "pavetwin" in loaded
    assert sorted(HEAVY & set(loaded)) == []


def options_named_in(path: Path) -> Iterator[tuple[int, str]]:
    """Line and text of every message that names an option outside a whole command; docstrings are not messages."""
    tree = ast.parse(path.read_text(encoding="utf-8"), str(path))
    skipped = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.JoinedStr):
            skipped |= {id(part) for part in node.values}
            text = "".join(str(part.value) if isinstance(part, ast.Constant) else "…" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            text = node.value
        else:
            continue
        is_argument = re.fullmatch(r"--?[\w.-]+([= ]\S*)?", text)
        if OPTION.search(re.sub(r"`pavetwin [^`]*`", "", text)) and not is_argument:
            yield node.lineno, text


def test_only_the_command_line_names_its_options() -> None:
    sources = (path for path in PACKAGE.rglob("*.py") if room_of(path, PACKAGE) != "cli")
    named = [f"{path.relative_to(PACKAGE)}:{line}: {text}" for path in sources for line, text in options_named_in(path)]
    assert sorted(named) == [], "name the parameter in backquotes"


def test_rooms_are_small() -> None:
    sources = [path for path in tracked_files() if path.relative_to(ROOT).parts[0] in {"src", "crates"}]
    sources = [path for path in sources if path.suffix in {".py", ".pyi", ".rs"}]
    assert sources, "no sources found"
    lengths = {str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines()) for path in sources}
    assert {name: lines for name, lines in lengths.items() if lines > MAX_LINES} == {}


def test_each_class_name_has_one_meaning_in_its_package() -> None:
    defined: dict[tuple[str, str], list[str]] = {}
    for path in sorted([*PACKAGE.rglob("*.py"), *PACKAGE.rglob("*.pyi")]):
        for node in ast.parse(path.read_text(encoding="utf-8"), str(path)).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                place = str(path.relative_to(PACKAGE))
                defined.setdefault((room_of(path, PACKAGE), node.name), []).append(place)
    assert len(defined) > 100, "no classes found"
    assert {name: places for name, places in defined.items() if len(places) > 1} == {}


def type_aliases(path: Path) -> Iterator[str]:
    """Public aliases of types at the top of a module: `Name = tuple[…]`, and not a TypeVar or a value."""
    for node in ast.parse(path.read_text(encoding="utf-8"), str(path)).body:
        if isinstance(node, ast.Assign) and isinstance(target := node.targets[0], ast.Name):
            is_type = isinstance(node.value, ast.Subscript | ast.BinOp | ast.Name | ast.Attribute)
            if is_type and re.fullmatch(r"[A-Z][a-z]\w*", target.id):
                yield target.id


def test_each_type_alias_has_one_meaning() -> None:
    """One definition, imported where it is used. Rows of a study's tables are plain mappings wherever they are made."""
    defined: dict[str, list[str]] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        for name in type_aliases(path):
            defined.setdefault(name, []).append(str(path.relative_to(PACKAGE)))
    assert len(defined) > 50, "no type aliases found"
    several = {name: places for name, places in defined.items() if len(places) > 1}
    assert {
        name for name, places in several.items() if not all(it.startswith("experiments/") for it in places)
    } == set()
    assert set(several) <= {"Row"}


def used_files(folder: Path) -> dict[str, set[str]]:
    """For each Rust file of a folder, the files next to it that it uses, by `super::` or by the crate's path."""
    names = {path.stem for path in folder.glob("*.rs")} - {"mod"}
    uses: dict[str, set[str]] = {}
    for name in sorted(names):
        source = re.sub(r"//.*", "", (folder / f"{name}.rs").read_text(encoding="utf-8"))
        found = re.findall(rf"\b(?:super|crate::{folder.name})::(\w+|\{{[^;]*\}})", source)
        uses[name] = {word for part in found for word in re.findall(r"\w+", part)} & names - {name}
    return uses


def circle_in(uses: dict[str, set[str]]) -> list[str]:
    """Files that use each other in a circle, or that use such files; none when the arrows all point down."""
    left = dict(uses)
    while bottom := [name for name, used in left.items() if not used & left.keys()]:
        for name in bottom:
            del left[name]
    return sorted(left)


def test_the_mission_kernel_has_no_circle() -> None:
    uses = used_files(ROOT / "crates" / "pavetwin-core" / "src" / "mission")
    assert {"encounter", "reaction", "task"} <= uses["flight"]
    assert circle_in(uses) == []


def used_packages(folder: Path, dotted: str) -> dict[str, set[str]]:
    """For each Python file and package in a folder, those next to it that it imports."""
    uses: dict[str, set[str]] = {}
    for path in sorted(folder.rglob("*.py")):
        name = path.relative_to(folder).parts[0].removesuffix(".py")
        found = re.findall(rf"^\s*from {re.escape(dotted)}\.(\w+)[\w.]* import", path.read_text("utf-8"), re.MULTILINE)
        uses[name] = uses.get(name, set()) | set(found) - {name}
    return uses


def test_the_packages_of_the_ground_have_no_circle() -> None:
    uses = used_packages(PACKAGE / "scene" / "ground", "pavetwin.scene.ground")
    assert {"layout", "markings", "distractors"} <= uses["ground_plan"]
    assert uses["materials"] == set()
    assert uses["layout"] == {"styles", "materials"}
    assert circle_in(uses) == []


def test_the_core_knows_no_python() -> None:
    manifest = tomllib.loads((ROOT / "crates" / "pavetwin-core" / "Cargo.toml").read_text(encoding="utf-8"))
    assert {"pyo3", "numpy"} & set(manifest["dependencies"]) == set()


def test_no_file_names_a_package_registry() -> None:
    named = []
    for path in tracked_files():
        text = path.read_bytes().decode("utf-8", errors="ignore").replace(CARGO_SOURCE, "").lower()
        named += [f"{path.relative_to(ROOT)}: {host}" for host in REGISTRY_HOSTS if host in text]
    assert named == []


TRAINING = (PACKAGE / "training" / "network", PACKAGE / "training" / "trainer")

OTHER_LICENCE = {"ultralytics"}
"""Optional packages under a licence that keeps them out of the extras (AGPL-3.0)."""


INSTALLED_BESIDE = {"rerun", "rerun-sdk"}
"""Optional packages outside the extras: a viewer of 170 MB that contacts other hosts. Its package has either name,
installed or not."""


def imported_packages(paths: Iterable[Path]) -> tuple[set[str], set[str]]:
    """Distributions that files import by a statement, and by name (`import_module`, `find_spec`)."""
    stated, named = set(), set()
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), str(path))):
            if isinstance(node, ast.Import):
                stated |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                stated.add(node.module)
            elif isinstance(node, ast.Call) and ast.unparse(node.func) in ("import_module", "find_spec"):
                named |= {str(word.value) for word in node.args if isinstance(word, ast.Constant)}
    return distributions_of(stated), distributions_of(named)


def distributions_of(modules: set[str]) -> set[str]:
    """The distributions that hold modules, those of Python itself and of the package excepted."""
    holders = packages_distributions()
    tops = {name.partition(".")[0] for name in modules} - set(sys.stdlib_module_names) - {PACKAGE.name}
    return {holder.lower() for top in tops for holder in holders.get(top, [top])}


def distributions_in(specs: list[str]) -> set[str]:
    return {re.split(r"[<>=]", spec)[0].strip().lower() for spec in specs}


def test_what_a_user_installs_is_what_the_package_imports() -> None:
    """Packages of an extra are imported by name where they are used, so that all else works without them. Training is
    loaded as a whole and imports its extra, NumPy and Pillow only."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    required = distributions_in(project["dependencies"])
    extras = {name: distributions_in(specs) for name, specs in project["optional-dependencies"].items()}
    training = {path for folder in TRAINING for path in folder.rglob("*.py")}
    to_train = extras.pop("train")
    # PyTorch imports onnxscript when it exports, and the evaluation imports pycocotools by name.
    assert imported_packages(training) == (to_train - {"onnxscript", "pycocotools"} | {"numpy", "pillow"}, set())
    extra = set().union(*extras.values())
    stated, named = imported_packages(set(PACKAGE.rglob("*.py")) - training)
    assert sorted(required - stated - named) == [], "required, and never imported"
    assert sorted(extra - named) == [], "in an extra, and never imported by name"
    assert sorted(stated - required) == [], "imported by a statement, and not required"
    elsewhere = required | extra | to_train | OTHER_LICENCE | INSTALLED_BESIDE
    assert sorted(named - elsewhere) == [], "imported by name, and in no extra either"


def test_what_has_another_licence_is_named_in_its_adapter_alone() -> None:
    adapter = PACKAGE / "training" / "evaluation" / "ultralytics_models.py"
    stated, named = imported_packages(set(PACKAGE.rglob("*.py")) - {adapter})
    assert not OTHER_LICENCE & (stated | named)
    assert imported_packages({adapter})[1] == OTHER_LICENCE
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8") + (ROOT / "requirements-train.lock").read_text()
    assert not any(name in text.lower() for name in OTHER_LICENCE)


def test_the_lock_covers_what_is_asked_for() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = [
        each for name in ("augment", "detect", "evaluate") for each in project["project"]["optional-dependencies"][name]
    ]
    names = distributions_in(project["project"]["dependencies"] + extras + project["dependency-groups"]["dev"])
    lock = (ROOT / "requirements.lock").read_text(encoding="utf-8").splitlines()
    locked = {line.partition("==")[0] for line in lock if "==" in line and not line.startswith((" ", "#"))}
    assert sorted(names - locked) == [], "run `make lock`"


def test_the_lock_of_training_adds_to_the_other() -> None:
    """Packages in both have one version, so that the tests of training run what users run."""
    asked = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    pins = {
        name: set(re.findall(r"^([\w.-]+==\S+)", (ROOT / name).read_text(encoding="utf-8"), flags=re.MULTILINE))
        for name in ("requirements.lock", "requirements-train.lock")
    }
    assert sorted(pins["requirements.lock"] - pins["requirements-train.lock"]) == [], "run `make lock`"
    locked = {pin.partition("==")[0] for pin in pins["requirements-train.lock"]}
    assert distributions_in(asked["train"]) <= locked, "run `make lock`"


def registries() -> list[dict[str, str]]:
    """Every registry that the source makes: its file, and what it is called with by keyword."""
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), str(path))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Registry":
                texts = {each.arg: each.value.value for each in node.keywords if isinstance(each.value, ast.Constant)}
                found.append({"file": str(path.relative_to(PACKAGE.parent)), **texts})
    return found


def test_what_goes_by_a_name_is_found_in_its_home() -> None:
    """A registry imports its home by itself, so that a new file there is all there is to add; it lives in that home, or
    beside a module that is one. Each has entry points of its own."""
    made = registries()
    assert len(made) >= 8
    for each in made:
        home = PACKAGE.parent / each["home"].replace(".", "/")
        assert home.is_dir() or home.with_suffix(".py").is_file(), each
        beside = home if home.is_dir() else home.parent
        assert (PACKAGE.parent / each["file"]).parent == beside, each
        assert each["group"].startswith("pavetwin."), each
    assert len({each["group"] for each in made}) == len(made)


def test_nothing_else_keeps_a_table_of_registered_names() -> None:
    """A dictionary that a decorator fills is half a registry: no plugin, no nearest name, not in worker processes."""
    table = re.compile(r"^_?[A-Z_]+: (?:Final\[)?dict\[str, (?:type|Callable)", re.MULTILINE)
    kept = [path for path in PACKAGE.rglob("*.py") if table.search(path.read_text(encoding="utf-8"))]
    assert kept == []
