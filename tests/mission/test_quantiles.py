"""Quantiles against SciPy's."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import betainc, betaincinv, stdtrit

from pavetwin.mission.quantiles import beta_quantile, beta_share, t_quantile

PARAMETER = st.floats(-6, 6).map(lambda power: 2.718281828**power)


@given(a=PARAMETER, b=PARAMETER, share=st.sampled_from([0.025, 0.3, 0.975]))
def test_of_a_beta_distribution(a: float, b: float, share: float) -> None:
    x = beta_quantile(a, b, share)
    assert x == pytest.approx(float(betaincinv(a, b, share)), rel=1e-9, abs=1e-290)
    if 1e-12 < x < 1 - 1e-12:
        assert beta_share(a, b, x) == pytest.approx(float(betainc(a, b, x)), rel=1e-9)


@given(freedom=st.floats(1, 1e4), share=st.floats(0.6, 0.999))
def test_of_students_t(freedom: float, share: float) -> None:
    assert t_quantile(freedom, share) == pytest.approx(float(stdtrit(freedom, share)), rel=1e-9)
