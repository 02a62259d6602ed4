"""What a training asks of the machine that it runs on."""

import os
import shlex
import shutil
import sys
from collections.abc import Sequence
from typing import Final

import torch

from pavetwin.errors import PaveTwinError
from pavetwin.training.datasets.examples import ExampleSet
from pavetwin.training.trainer.augment import Member
from pavetwin.training.trainer.device_pictures import room_of
from pavetwin.training.trainer.held_pictures import GIGABYTE, HeldExampleSet, is_inherited
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions

PICTURES_SHARE: Final = 0.25
"""Of a graphics card's free memory that training pictures may take, so that views are drawn there."""

HALF_INSTRUCTIONS: Final = ("amx_bf16", "avx512_bf16")
"""Of processors that multiply bfloat16 faster than single precision, as `torch.cpu.get_capabilities` names them."""

_CPP_COMPILERS: Final = {"darwin": "clang++", "win32": "cl"}
"""What `torch.compile` starts where CXX names none; elsewhere it is g++."""


def draws_views(
    training: Sequence[Member], options: TrainingOptions, machine: TrainingMachine, device: torch.device
) -> bool:
    """Whether the device holds the training pictures and draws views of them.

    Raises:
        PaveTwinError: that is asked for, and it has no room, or photographs without labels are used, which only a
            processor does.
    """
    if machine.views == "device" and options.adaptations:
        told = ", ".join(options.adaptations)
        raise PaveTwinError(f"`views` device: a processor draws views where {told} is set; leave `views` out.")
    if machine.views == "processor" or options.adaptations:
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
    """Check that what `torch.compile` writes can be built: C++ for a processor, and C to start kernels on a card.

    Raises:
        PaveTwinError: compiling is asked for, and there is no compiler.
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
    """The datasets, which decode each picture of some splits once.

    Processes that prepare images end with each epoch, and what they would keep is lost. So they get all from here where
    they are forked, and keep nothing elsewhere.
    """
    if machine.workers and not is_inherited():
        return sets
    return [HeldExampleSet.of(each, round(machine.held_gb * GIGABYTE), splits) for each in sets]


def device_of(machine: TrainingMachine) -> torch.device:
    """The device that trains.

    Raises:
        PaveTwinError: it is not there.
    """
    try:
        device = torch.device(machine.device or ("cuda" if torch.cuda.is_available() else "cpu"))
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:
        raise PaveTwinError(f"`device`: '{machine.device}' cannot be used here.") from error
    return device


def has_half(device: torch.device) -> bool:
    """Whether bfloat16 is faster than single precision there: on most graphics cards, and on processors with
    instructions for it (AMX or AVX-512 BF16)."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported()
    told = getattr(torch.cpu, "get_capabilities", None)  # not in all versions
    return device.type == "cpu" and told is not None and any(map(told().get, HALF_INSTRUCTIONS))
