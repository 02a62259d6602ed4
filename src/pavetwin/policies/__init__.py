"""Π: what to do when traffic hides the road. One file a policy, one registry."""

from pavetwin.policies.base import Action, Displace, GoOn, Pilot, Policy, Revisit, Wait
from pavetwin.policies.baseline import Baseline
from pavetwin.policies.conformance import check_policy
from pavetwin.policies.hover import Hover
from pavetwin.policies.micro import Micro
from pavetwin.policies.registered import POLICIES, load_policy, policy, policy_class, policy_names
from pavetwin.policies.skip import Skip

__all__ = [
    "POLICIES",
    "Action",
    "Baseline",
    "Displace",
    "GoOn",
    "Hover",
    "Micro",
    "Pilot",
    "Policy",
    "Revisit",
    "Skip",
    "Wait",
    "check_policy",
    "load_policy",
    "policy",
    "policy_class",
    "policy_names",
]
