"""Where policies are registered, and how one is found by its name or its file."""

from pavetwin.config.mission import PolicySettings
from pavetwin.plugins import find_class
from pavetwin.policies.base import Policy
from pavetwin.policies.conformance import check_policy
from pavetwin.registry import Registry


def _named(name: str, kind: type[Policy]) -> None:
    kind.name = name


POLICIES: Registry[type[Policy]] = Registry(
    "policy", key="policy", group="pavetwin.policies", home="pavetwin.policies", on_add=_named, rules=check_policy
)
policy = POLICIES.register
"""Register a policy under a name, which `policy` then takes."""


def policy_names() -> list[str]:
    """The registered policies, in the order of registration."""
    return POLICIES.names()


def load_policy(name: str, settings: PolicySettings) -> Policy:
    """The policy of a name, or a user's own as `path/to/file.py:ClassName`.

    Raises:
        PaveTwinError: as `policy_class`, or an option does not fit.
    """
    return policy_class(name)(settings)


def policy_class(name: str) -> type[Policy]:
    """A registered policy's class, or that of `path/to/file.py:ClassName`, once it has passed `check_policy`.

    Raises:
        PaveTwinError: there is none, its file does not give a policy, or the policy breaks a rule.
    """
    kind = find_class(POLICIES, Policy, name)
    if "name" not in vars(kind):
        kind.name = kind.__name__  # not its base's: a changed hover is not hover
    return kind
