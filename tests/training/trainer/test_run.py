"""A run: stopped and continued, killed and continued, refused; always with one curve and nothing lost."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from math import exp
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from pavetwin.errors import PaveTwinError
from pavetwin.labels.class_names import CLASSES, ROAD_DEFECT
from pavetwin.training.datasets.examples import ExampleSet, read_coco
from pavetwin.training.trainer import trainer
from pavetwin.training.trainer.__main__ import main
from pavetwin.training.trainer.batches import TrainingViews
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions
from pavetwin.training.trainer.pictures import HeldExampleSet
from pavetwin.training.trainer.run_folder import load_network
from pavetwin.training.trainer.schedule import MovingAverage, epoch_order, phases_of, rate_at
from pavetwin.training.trainer.trainer import Silent, Trainer, check_compiler, has_half
from scenes.drawn_roads import NAMES, drawn_roads

PERSON, CAR = 1, 2  # in `COARSE`

TINY = TrainingOptions(
    width=0.03, depth=0.01, image_px=64, epochs=2, classifier_epochs=1, batch=4, warmup_epochs=1, mosaic_off=1, seed=3
)
BLOCKED = (
    *("contourpy", "cv2", "defusedxml", "distributed", "duckdb", "libsumo", "matplotlib", "osmium"),
    *("polars", "pyarrow", "pydantic", "pyogrio", "pyproj", "rich", "scipy", "shapely", "typer", "wgpu", "yaml"),
    "pavetwin._core",
)
"""What PaveTwin uses and a machine that only trains need not have."""

CPU = TrainingMachine(device="cpu")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def whole(data: list[ExampleSet], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run without interruption."""
    path = tmp_path_factory.mktemp("runs") / "whole"
    assert Trainer(data, path, TINY, CPU, Silent()).run()
    return path


def same(one: Path, other: Path) -> bool:
    """Whether two runs have the same curves and the same weights, bit by bit."""
    weights = [load_network(path / "best.pt")[0].state_dict() for path in (one, other)]
    equal = all(torch.equal(value, weights[1][name]) for name, value in weights[0].items())
    return equal and (one / "curves.csv").read_bytes() == (other / "curves.csv").read_bytes()


def test_a_run_has_a_row_for_each_epoch_and_weights(whole: Path) -> None:
    lines = (whole / "curves.csv").read_text().splitlines()
    assert lines[0].startswith("phase,epoch,rate,box,classes,distribution,subtype,mask,total,map50,map,Single Crack,")
    epochs = [[each["phase"], each["epoch"]] for each in csv.DictReader(lines)]
    assert epochs == [["all", "1"], ["all", "2"], ["all, classifier", "1"]]
    assert sorted(path.name for path in whole.iterdir()) == ["best.pt", "checkpoint.pt", "curves.csv", "run.json"]
    network, told = load_network(whole / "best.pt")
    assert network.architecture == TINY.architecture
    assert told["options"]["seed"] == 3


def test_a_finished_run_is_not_trained_again(whole: Path, data: list[ExampleSet]) -> None:
    before = (whole / "curves.csv").read_bytes()
    assert Trainer(data, whole, TINY, CPU, Silent()).run()
    assert (whole / "curves.csv").read_bytes() == before


def test_a_run_in_chunks_is_the_same_run(whole: Path, data: list[ExampleSet], tmp_path: Path) -> None:
    """Stopped after every step, within epochs too."""
    chunks = 1
    while not Trainer(data, tmp_path / "run", TINY, CPU, Silent()).run(stop_after_s=0.0):
        chunks += 1
    assert chunks > 6
    assert same(tmp_path / "run", whole)


def test_a_killed_run_goes_on_to_the_same_curve(whole: Path, folder: Path, tmp_path: Path) -> None:
    values = [f"--set={name}={value}" for name, value in TINY.as_mapping().items() if value != ""]
    command = [sys.executable, "-m", "pavetwin.training.trainer", folder, "-o", tmp_path / "run", "--device=cpu"]
    started = subprocess.Popen(
        [*map(str, command), *values], stderr=subprocess.PIPE, env={**os.environ, "PYTHONHASHSEED": "1"}
    )
    deadline = time.monotonic() + 120
    while not (tmp_path / "run" / "checkpoint.pt").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    started.send_signal(signal.SIGKILL)
    started.wait()
    ended = subprocess.run([*map(str, command), *values], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.startswith("Finished")
    assert same(tmp_path / "run", whole)


def test_another_seed_is_another_run(whole: Path, data: list[ExampleSet], tmp_path: Path) -> None:
    Trainer(data, tmp_path / "run", replace(TINY, seed=4), CPU, Silent()).run()
    assert not same(tmp_path / "run", whole)


@pytest.mark.parametrize(("workers", "held_gb"), [(1, 2.0), (1, 0.0), (0, 0.0)])
def test_processes_and_memory_do_not_change_a_run(
    whole: Path, data: list[ExampleSet], tmp_path: Path, workers: int, held_gb: float
) -> None:
    machine = TrainingMachine("cpu", workers=workers, held_gb=held_gb)
    assert Trainer(data, tmp_path / "run", TINY, machine, Silent()).run()
    assert same(tmp_path / "run", whole)


def test_views_drawn_on_the_device_teach_the_same(whole: Path, data: list[ExampleSet], tmp_path: Path) -> None:
    machine = TrainingMachine("cpu", views="device")
    assert Trainer(data, tmp_path / "run", TINY, machine, Silent()).run()
    first, other = (
        [float(value) for value in (path / "curves.csv").read_text().splitlines()[1].split(",")[2:9]]
        for path in (whole, tmp_path / "run")
    )
    assert other == pytest.approx(first, rel=0.05)
    assert not same(tmp_path / "run", whole)  # colours are not rounded to whole numbers


@pytest.fixture
def compiled_calls(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A step of the average for each call of a network that was compiled."""
    calls: list[int] = []

    def compile_(called: Callable[..., Any], **_: Any) -> Callable[..., Any]:
        return lambda images: calls.append(len(images)) or called(images)

    monkeypatch.setattr(torch, "compile", compile_)
    return calls


def test_a_compiled_network_teaches_the_same(whole: Path, data: list[ExampleSet], tmp_path: Path) -> None:
    found = {}
    for compiled in (False, True):
        run, machine = tmp_path / str(compiled), TrainingMachine("cpu", compiled=compiled)
        trainer = Trainer(data, run, replace(TINY, epochs=1), machine, Silent(), whole / "best.pt")
        assert trainer.run()
        found[compiled] = trainer.curves[0]["total"]
    assert found[True] == pytest.approx(found[False], rel=1e-3)


@pytest.mark.parametrize("compiled", [False, True])
def test_every_step_from_given_weights_is_compiled(
    whole: Path, data: list[ExampleSet], tmp_path: Path, compiled_calls: list[int], *, compiled: bool
) -> None:
    machine = TrainingMachine("cpu", compiled=compiled)
    assert Trainer(data, tmp_path / "run", TINY, machine, Silent(), whole / "best.pt").run()
    assert compiled_calls == [4] * (6 if compiled else 0)  # two epochs of three steps; the heads alone are not


def test_from_random_weights_a_network_is_compiled_once_its_normalisation_is_settled(
    data: list[ExampleSet], tmp_path: Path, compiled_calls: list[int]
) -> None:
    options = replace(TINY, epochs=1, repeats=14, classifier_epochs=0)
    assert Trainer(data, tmp_path / "run", options, TrainingMachine("cpu", compiled=True), Silent()).run()
    assert compiled_calls == [4] * (3 * 14 - 34)


def test_pictures_that_the_device_holds_are_not_kept_elsewhere(
    data: list[ExampleSet], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held: list[tuple[str, ...]] = []
    monkeypatch.setattr(HeldExampleSet, "hold", lambda self, _: held.append(self.splits))
    for views in ("device", "processor"):
        Trainer(data, tmp_path / views, TINY, TrainingMachine("cpu", workers=1, views=views), Silent())
    assert held == [("val",)] * len(data) + [("train", "val")] * len(data)


def test_a_command_says_where_views_are_drawn(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    values = [f"--set={name}={value}" for name, value in TINY.as_mapping().items() if value != ""]
    words = [str(folder), "-o", str(tmp_path / "run"), "--device", "cpu"]
    assert main([*words, *values, "--views", "devise"]) == 2
    assert "did you mean 'device'" in capsys.readouterr().err
    assert main([*words, *values, "--views", "device"]) == 0
    precision = "bfloat16" if has_half(torch.device("cpu")) else "single precision"
    told = f"Training on cpu in {precision}; views are drawn by"
    assert capsys.readouterr().err.count(f"{told} cpu, labels are made by this process.") == 1
    processes = [*values, "--workers", "2", "--set=epochs=1", "--set=classifier_epochs=0"]
    assert main([words[0], "-o", str(tmp_path / "other"), *words[3:], *processes, "--views", "processor"]) == 0
    assert capsys.readouterr().err.count(f"{told} 2 processes.") == 1


@pytest.mark.parametrize(
    ("capabilities", "is_used"),
    [({"amx_bf16": True}, True), ({"amx_bf16": False, "avx512_bf16": True}, True), ({"avx512_f": True}, False)],
    ids=["amx", "avx512 bf16", "avx512"],
)
def test_processors_with_instructions_for_it_train_in_mixed_precision(
    monkeypatch: pytest.MonkeyPatch, capabilities: dict[str, bool], *, is_used: bool
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: capabilities)
    assert has_half(torch.device("cpu")) is is_used


def test_compiling_without_a_compiler_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.delenv("CC", raising=False)
    words = [str(folder), "-o", str(tmp_path / "run"), "--device", "cpu", "--compile"]
    assert main(words) == 2
    assert "Error: --compile: it needs a compiler (g++), and there is none" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
    monkeypatch.setenv("CXX", "nosuch++ -O2")
    assert main(words) == 2
    assert "it needs a compiler (nosuch++)" in capsys.readouterr().err
    compiled = TrainingMachine("cpu", compiled=True)
    with pytest.raises(PaveTwinError, match=r"a compiler \(gcc, clang\), and there is none; .* name it in CC"):
        check_compiler(compiled, torch.device("cuda"))
    for name in ("nosuch++", "clang"):
        (tmp_path / name).write_text("")
        (tmp_path / name).chmod(0o755)
    check_compiler(compiled, torch.device("cpu"))
    check_compiler(compiled, torch.device("cuda"))


@pytest.mark.parametrize("amount", ["-1", "inf", "nan"])
def test_memory_is_a_finite_amount(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], amount: str
) -> None:
    assert main([str(folder), "-o", str(tmp_path / "run"), "--held-gb", amount]) == 2
    assert f"Error: --held-gb {amount}: it must be 0 or more, and finite." in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_training_needs_nothing_but_torch_numpy_and_pillow(folder: Path, tmp_path: Path) -> None:
    """With everything else that PaveTwin uses blocked, the kernel too, a run is trained."""
    script = f"""
import sys
sys.modules.update(dict.fromkeys({BLOCKED!r}))
from pavetwin.training.trainer.__main__ import main
sys.exit(main([{str(folder)!r}, "-o", {str(tmp_path / "run")!r}, "--device", "cpu", "--set", "width=0.03", "--set",
               "epochs=1", "--set", "classifier_epochs=0", "--set", "image_px=64", "--set", "depth=0.01"]))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run" / "best.pt").is_file()


def refusal(*arguments: object) -> str:
    with pytest.raises(PaveTwinError) as refused:
        Trainer(*arguments)  # type: ignore[arg-type]
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_a_folder_with_a_run_of_other_data_is_refused(whole: Path, data: list[ExampleSet]) -> None:
    before = {path: path.read_bytes() for path in whole.iterdir()}
    changed = [replace(data[0], fingerprint="0" * 64)]
    assert "holds a run with data " in refusal(changed, whole, TINY, CPU, Silent())
    assert {path: path.read_bytes() for path in whole.iterdir()} == before


def test_a_folder_with_something_else_is_refused(data: list[ExampleSet], folder: Path) -> None:
    assert "exists and holds no run" in refusal(data, folder, TINY, CPU, Silent())


def test_weights_to_begin_with_are_taken(whole: Path, data: list[ExampleSet], tmp_path: Path) -> None:
    trainer = Trainer(data, tmp_path / "run", TINY, CPU, Silent(), whole / "best.pt")
    begun = trainer.network.state_dict()
    wanted = load_network(whole / "best.pt")[0].state_dict()
    assert all(torch.equal(value, begun[name]) for name, value in wanted.items())


def test_a_source_that_only_validates_is_validated_by_what_it_labels(folder: Path, tmp_path: Path) -> None:
    labels = drawn_roads(tmp_path / "other", {"val": 3}, size=(64, 48)) / "annotations" / "instances_val.json"
    content = json.loads(labels.read_text())
    content["info"] = {"description": "a source without training images"}
    content["annotations"] = [row for row in content["annotations"] if NAMES[row["category_id"] - 1] != "Car"]
    labels.write_text(json.dumps(content))
    sets = [read_coco(folder, ("train",)), read_coco(tmp_path / "other", ("val",))]
    trainer = Trainer(sets, tmp_path / "run", TINY, CPU, Silent())
    assert trainer._known["a source without training images"] == {ROAD_DEFECT, PERSON}
    assert trainer._known["drawn roads"] == {ROAD_DEFECT, PERSON, CAR}
    assert trainer.run()


def test_what_is_told_in_the_end_is_of_the_weights_that_are_kept(whole: Path, data: list[ExampleSet]) -> None:
    trainer = Trainer(data, whole, TINY, CPU, Silent())
    assert trainer.best_map50 == load_network(whole / "best.pt")[1]["map50"]
    assert trainer.best_map50 in [row["map50"] for row in trainer.curves]


@pytest.mark.parametrize("content", [b"", b"no weights", b"this is text", b"PK\x03\x04" + 100 * b"\0"])
def test_a_damaged_checkpoint_is_refused(whole: Path, data: list[ExampleSet], tmp_path: Path, content: bytes) -> None:
    run = tmp_path / "run"
    run.mkdir()
    (run / "run.json").write_bytes((whole / "run.json").read_bytes())
    (run / "checkpoint.pt").write_bytes(content)
    assert "is damaged, or not a file of weights" in refusal(data, run, TINY, CPU, Silent())


def test_the_stages_have_their_images(folder: Path, tmp_path: Path) -> None:
    synthetic = read_coco(drawn_roads(tmp_path, {"train": 30, "val": 1}, size=(64, 48), synthetic=True), ("train",))
    real = read_coco(folder, ("train",))
    members = [(data, example) for data in (real, synthetic) for example in data.examples]
    for order, expected in {
        "real-synthetic": [("real", 12, 0), ("synthetic", 30, 10), ("synthetic, classifier", 30, 10)],
        "synthetic-real": [("synthetic", 30, 0), ("real", 12, 4), ("real, classifier", 12, 4)],
        "mixed": [("mixed", 30, 10), ("mixed, classifier", 30, 10)],
        "real": [("real", 12, 0), ("real, classifier", 12, 0)],
        "synthetic": [("synthetic", 30, 0), ("synthetic, classifier", 30, 0)],
    }.items():
        phases = phases_of(members, replace(TINY, order=order))
        assert [(phase.name, phase.main, phase.drawn) for phase in phases] == expected
    skipped = phases_of(members, replace(TINY, order="synthetic-real", skip_first=True))
    assert [(phase.name, phase.drawn) for phase in skipped] == [("real", 4), ("real, classifier", 4)]
    phase = phases_of(members, TINY)[1]
    for epoch in range(3):
        shown = [phase.members[at][1].is_synthetic for at in epoch_order(phase, (0, 1, epoch))]
        assert (sum(shown), len(shown)) == (30, 40)
    assert epoch_order(phase, (0, 1, 0)) != epoch_order(phase, (0, 1, 1))
    thrice = phases_of(members, replace(TINY, repeats=3))[1]
    assert (thrice.main, thrice.drawn) == (3 * phase.main, 3 * phase.drawn)
    order = [thrice.members[at][1] for at in epoch_order(thrice, (0, 1, 0))]
    assert all(order.count(example) == 3 for _, example in phase.members[: phase.main])


def test_the_rate_rises_and_falls() -> None:
    rates = [rate_at(step, 100, 10, TINY) for step in range(100)]
    assert rates[0] == pytest.approx(TINY.rate / 10)
    assert max(rates) == rates[9] == pytest.approx(TINY.rate)
    assert rates[55] == pytest.approx(TINY.rate * (0.01 + 0.99 / 2))
    assert rates[-1] == pytest.approx(TINY.rate * 0.01, rel=0.05)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (["epoch=3"], "`overrides`: no setting 'epoch' (did you mean 'epochs'?)"),
        (["epochs=three"], "`overrides`: epochs takes a whole number (got 'three')."),
        (["masks=yes"], "`overrides`: masks takes true or false (got 'yes')."),
        (["epochs"], "`overrides`: 'epochs' is not a setting; give name=value"),
        (["rate=2"], "`rate` 2: it must be from 0 to 1."),
        (["image_px=100"], "`image_px` 100: it must be a multiple of 32."),
        (["order=real-sinthetic"], "`order`: no order 'real-sinthetic' (did you mean 'real-synthetic'?)"),
        (["without=Cra"], "`without`: no class 'Cra'"),
    ],
)
def test_wrong_settings_are_refused(values: list[str], message: str) -> None:
    with pytest.raises(PaveTwinError) as refused:
        TrainingOptions.parse(values)
    assert message in str(refused.value)


def test_the_average_forgets_fast_at_first_and_slowly_later() -> None:
    network = torch.nn.Sequential(torch.nn.Linear(1, 1, bias=False), torch.nn.BatchNorm1d(1))
    options = replace(TINY, ema_decay=0.9, ema_steps=10)
    average, expected = MovingAverage(network, options), network[0].weight.item()
    for step in range(1, 6):
        with torch.no_grad():
            network[0].weight.fill_(float(step))
            network[1].num_batches_tracked.fill_(step)
        average.update(network)
        decay = 0.9 * (1 - exp(-step / 10))
        expected = decay * expected + (1 - decay) * step
        assert average.network[0].weight.item() == pytest.approx(expected, rel=1e-5)
        assert int(average.network[1].num_batches_tracked) == step


SHORT = TrainingOptions(
    width=0.03, depth=0.01, image_px=64, epochs=4, classifier_epochs=1, batch=4, warmup_epochs=1, mosaic_off=0
)


def phases(run: Path) -> list[str]:
    """The phase of each epoch."""
    return [row.split(",")[0] for row in (run / "curves.csv").read_text().splitlines()[1:]]


@pytest.mark.parametrize(("patience", "epochs"), [(1, 2), (2, 3), (9, 4)])
def test_a_phase_ends_after_as_many_epochs_without_a_better_result(
    data: list[ExampleSet], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, patience: int, epochs: int
) -> None:
    """All epochs are as good as the first."""
    monkeypatch.setattr(Trainer, "_validate", lambda _: np.full((len(CLASSES), 10), 0.5))
    options = replace(SHORT, patience=patience, classifier_epochs=0)
    Trainer(data, tmp_path / "run", options, TrainingMachine("cpu"), Silent()).run()
    assert phases(tmp_path / "run") == ["all"] * epochs


def test_the_last_epochs_and_the_classifier_s_are_without_mosaics(
    data: list[ExampleSet], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[tuple[int, int, float]] = []

    def views(members: Any, order: Any, known: Any, options: Any, mask_px: Any, key: Any, *others: Any) -> Any:
        shown.append((key[1], key[2], options.mosaic))
        return TrainingViews(members, order, known, options, mask_px, key, *others)

    monkeypatch.setattr(trainer, "TrainingViews", views)
    options = replace(SHORT, mosaic=0.7, mosaic_off=2)
    Trainer(data, tmp_path / "run", options, TrainingMachine("cpu"), Silent()).run()
    assert shown == [(0, 0, 0.7), (0, 1, 0.7), (0, 2, 0.0), (0, 3, 0.0), (1, 0, 0.0)]
