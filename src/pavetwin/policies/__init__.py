"""Π: what to do when traffic hides the road. One file a policy, one registry."""

from pavetwin.policies.base import (
    Action,
    Displace,
    GoOn,
    Policy,
    Revisit,
    Wait,
    policy,
    policy_names,
)
from pavetwin.policies.baseline import Baseline
from pavetwin.policies.conformance import check_policy
from pavetwin.policies.hover import Hover
from pavetwin.policies.loading import helpers_of, load_policy
from pavetwin.policies.micro import Micro
from pavetwin.policies.skip import Skip

__all__ = [
    "Action",
    "Baseline",
    "Displace",
    "GoOn",
    "Hover",
    "Micro",
    "Policy",
    "Revisit",
    "Skip",
    "Wait",
    "check_policy",
    "helpers_of",
    "load_policy",
    "policy",
    "policy_names",
]
