"""MKL has chosen its kernels when a network can be run; the race itself is too rare to test."""

from training import build_detector
from training.vector_math import settle_vector_math


def test_before_a_network_can_run():
    settle_vector_math.cache_clear()
    build_detector("pointpillars_tiny", ["Car"])
    assert settle_vector_math.cache_info().currsize == 1
