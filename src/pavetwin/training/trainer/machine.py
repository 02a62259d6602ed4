"""Device, compiler and memory that a training uses."""

import os
import shlex
import shutil
import sys
from collections.abc import Sequence
from typing import Final

import torch

from pavetwin.errors import PaveTwinError
from pavetwin.training.datasets.examples import ExampleSet
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions
from pavetwin.training.trainer.pictures import GIGABYTE, HeldExampleSet, is_inherited, room_of
from pavetwin.training.trainer.views import Member

PICTURES_SHARE: Final = 0.25
"""Maximum share of a graphics card's free memory for training images, if views are drawn there by default."""

HALF_INSTRUCTIONS: Final = ("amx_bf16", "avx512_bf16")
"""Processor instructions that multiply bfloat16 faster than single precision, in `torch.cpu.get_capabilities`."""

_CPP_COMPILERS: Final = {"darwin": "clang++", "win32": "cl"}
"""Compiler that `torch.compile` starts unless CXX names one; on other systems it is g++."""


def draws_views(
    training: Sequence[Member], options: TrainingOptions, machine: TrainingMachine, device: torch.device
) -> bool:
    """Whether the device holds the training images and draws the views.

    Raises:
        PaveTwinError: this is requested, and the device has too little memory.
    """
    if machine.views == "processor":
        return False
    if device.type != "cuda":
        return machine.views == "device"
    free, _ = torch.cuda.mem_get_info(device)
    needed = room_of(training, options.image_px)
    if machine.views == "device":
        if needed > free:
            raise PaveTwinError(
                f"`views` device: the pictures and the drawing take {needed / GIGABYTE:.1f} GB, and {device} has "
                f"{free / GIGABYTE:.1f} free; leave `views` out."
            )
        return True
    return needed <= free * PICTURES_SHARE


def check_compiler(machine: TrainingMachine, device: torch.device) -> None:
    """Check for the compiler that `torch.compile` needs: C++ for a processor, C for a graphics card.

    Raises:
        PaveTwinError: compilation is requested, and there is no compiler.
    """
    variable, names = "CXX", [_CPP_COMPILERS.get(sys.platform, "g++")]
    if device.type == "cuda":
        variable, names = "CC", ["gcc", "clang"]
    wanted = shlex.split(os.environ.get(variable, ""))[:1] or names
    if machine.compiled and not any(map(shutil.which, wanted)):
        raise PaveTwinError(
            f"`compiled`: it needs a compiler ({', '.join(wanted)}), and there is none; install one, name it in "
            f"{variable}, or leave `compiled` out."
        )


def held_sets(sets: Sequence[ExampleSet], machine: TrainingMachine, splits: Sequence[str]) -> Sequence[ExampleSet]:
    """The datasets with decoded images of some splits kept in memory.

    Worker processes end with each epoch and lose what they keep. So forked workers inherit the images from this
    process, and other workers keep none.
    """
    if machine.workers and not is_inherited():
        return sets
    return [HeldExampleSet.of(each, round(machine.held_gb * GIGABYTE), splits) for each in sets]


def device_of(machine: TrainingMachine) -> torch.device:
    """Device of the training.

    Raises:
        PaveTwinError: it does not exist.
    """
    try:
        device = torch.device(machine.device or ("cuda" if torch.cuda.is_available() else "cpu"))
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:
        raise PaveTwinError(f"`device`: '{machine.device}' cannot be used here.") from error
    return device


def has_half(device: torch.device) -> bool:
    """Whether bfloat16 is faster than single precision: on most graphics cards, and on processors with AMX or AVX-512
    BF16."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported()
    capabilities = getattr(torch.cpu, "get_capabilities", None)  # missing in some versions
    return device.type == "cpu" and capabilities is not None and any(map(capabilities().get, HALF_INSTRUCTIONS))
