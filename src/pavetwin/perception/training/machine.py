"""What a training asks of the machine that it runs on."""

from collections.abc import Sequence
from typing import Final

import torch

from pavetwin.errors import PaveTwinError
from pavetwin.perception.examples.example import ExampleSet
from pavetwin.perception.training.augment import Member
from pavetwin.perception.training.device_pictures import room_of
from pavetwin.perception.training.held_pictures import GIGABYTE, HeldExampleSet, is_inherited
from pavetwin.perception.training.options import TrainingMachine, TrainingOptions

PICTURES_SHARE: Final = 0.25
"""Of a graphics card's free memory that training pictures may take, so that views are drawn there."""


def draws_views(
    training: Sequence[Member], options: TrainingOptions, machine: TrainingMachine, device: torch.device
) -> bool:
    """Whether the device holds the training pictures and draws views of them.

    Raises:
        PaveTwinError: that is asked for, and pictures are to be changed one by one, which only a processor does.
    """
    if machine.views == "device":
        if options.adaptations:
            told = ", ".join(options.adaptations)
            raise PaveTwinError(f"`views` device: a processor draws views where {told} is set; leave `views` out.")
        return True
    if machine.views or device.type != "cuda" or options.adaptations:
        return False
    free, _ = torch.cuda.mem_get_info(device)
    return room_of(training) <= free * PICTURES_SHARE


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
    """Whether bfloat16 is faster than single precision there: on most graphics cards, and on processors with matrix
    units for it (AMX)."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported()
    told = getattr(torch.cpu, "get_capabilities", None)  # not in all versions
    return device.type == "cpu" and told is not None and bool(told().get("amx_bf16"))
