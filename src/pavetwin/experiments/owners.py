"""Which policies or sensors a swept setting belongs to: the others lack it, and are flown once for all its values."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

from pavetwin.config.mission import PolicySettings
from pavetwin.config.settings import ALIASES
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import Design
from pavetwin.policies import policy_class, policy_names
from pavetwin.reports.words import listed
from pavetwin.sensing import sensor_class

Owners = Mapping[str, Sequence[str]]
"""Swept setting, as the design names it → the policies or sensors that have it, as the design names them. A setting
that all of them have, or that belongs to no policy and no sensor, is not named."""

EVERYONE: Final[Owners] = MappingProxyType({})


def owners_of(design: Design) -> dict[str, list[str]]:
    """The owners of a design's swept settings; its plugins are loaded.

    Raises:
        PaveTwinError: a policy or sensor is not known, or no policy of the design reads a setting of policies.
    """
    found = {}
    for key in design.sweep:
        section, _, setting = ALIASES.get(key, key).partition(".")
        option = setting.removeprefix("options.") if setting.startswith("options.") else None
        if option is not None and section in ("policy", "sensing"):
            names = design.policies if section == "policy" else design.sensors
            has = [name for name in names if option in _options(section, name)]
        elif section == "policy" and setting in PolicySettings.model_fields:
            names = design.policies
            has = [name for name in names if setting in policy_class(name).reads]
            if not has:
                those = [name for name in policy_names() if setting in policy_class(name).reads]
                raise PaveTwinError(
                    f"the design: sweep: no policy of the design reads {key}; of all, {listed(those)} "
                    f"{'does' if len(those) == 1 else 'do'}."
                )
        else:
            continue
        if 0 < len(has) < len(names):  # an option that none has is refused where settings are made
            found[key] = has
    return found


def has_setting(owners: Owners, key: str, policy: str, sensor: str) -> bool:
    """Whether missions of a policy with a sensor have a swept setting."""
    if key not in owners:
        return True
    return (policy if _is_of_policies(key) else sensor) in owners[key]


def sentences(design: Design, owners: Owners, names: Mapping[str, str]) -> list[str]:
    """`Only hover has wait_s: baseline and skip are flown once for all its values.`

    Args:
        names: of the policies of the design.
    """
    said = []
    for key, having in owners.items():
        every = design.policies if _is_of_policies(key) else design.sensors
        lacking = [names.get(name, name) for name in every if name not in having]
        verb = "is" if len(lacking) == 1 else "are"
        only = listed([names.get(name, name) for name in having])
        said.append(
            f"Only {only} {'has' if len(having) == 1 else 'have'} {key}: {listed(lacking)} {verb} flown once for all "
            "its values."
        )
    return said


def _is_of_policies(key: str) -> bool:
    return ALIASES.get(key, key).startswith("policy.")


def _options(section: str, name: str) -> Mapping[str, object]:
    return (policy_class(name) if section == "policy" else sensor_class(name)).default_options
