"""Recovery policies Π, for roads hidden by traffic: the shipped ones, and the registry."""

from pavetwin.policies.builtin import Baseline, Hover, Micro, Skip
from pavetwin.policies.policy import Action, Displace, GoOn, Pilot, Policy, Revisit, Wait
from pavetwin.policies.registered import POLICIES, check_policy, load_policy, policy, policy_class, policy_names

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
