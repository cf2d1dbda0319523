import numpy as np
import pandas as pd
import pytest

from tracking.report.sections.correlation import fit_detection_probability

PLACEMENTS = list("abcdefgh")
QS = np.geomspace(1e-3, 1, 13)


@pytest.fixture
def gains():
    """Placements differ in the voxels and in the rays a voxel that they reach."""
    rng = np.random.default_rng(0)
    voxels, rays = rng.uniform(1e3, 1e4, 8), rng.uniform(1, 300, 8)
    table = voxels[:, None] * (1 - (1 - QS) ** rays[:, None])
    return pd.DataFrame(table, index=PLACEMENTS, columns=QS)


@pytest.mark.parametrize("slope", [0.004, -0.004])
def test_a_true_q_is_found_whatever_the_sign(gains, slope):
    ap = 70 + slope * gains[QS[4]]
    fitted = fit_detection_probability(gains, ap.sample(frac=1, random_state=0))
    assert fitted.q == QS[4]
    assert (fitted.placements["q"] == QS[4]).all()
    np.testing.assert_allclose(fitted.placements["predicted"], ap, rtol=1e-9)
    assert fitted.rmse < 1e-9 < fitted.rmse_of_mean


def test_a_placement_has_no_part_in_its_own_prediction(gains):
    ap = 70 + 0.004 * gains[QS[4]]
    ap["c"] = 5.0
    fitted = fit_detection_probability(gains, ap)
    assert fitted.placements.loc["c", "q"] == QS[4]
    assert fitted.placements.loc["c", "predicted"] == pytest.approx(
        70 + 0.004 * gains.loc["c", QS[4]]
    )


def test_left_out_predictions_of_noise_are_no_better_than_the_mean(gains):
    """Fitted to all placements noise always looks predicted; left out it does not."""
    rng = np.random.default_rng(1)
    ratios, flattered = [], []
    for _ in range(200):
        ap = pd.Series(rng.normal(70, 3, 8), PLACEMENTS)
        fitted = fit_detection_probability(gains, ap)
        ratios.append(fitted.rmse / fitted.rmse_of_mean)
        flattered.append(max(abs(np.corrcoef(gains[q], ap)[0, 1]) for q in QS))
    assert np.median(ratios) > 1
    assert np.median(flattered) > 0.25


def test_placements_that_are_alike_for_a_q(gains):
    gains[QS[0]] = 1.0
    ap = 70 + 0.004 * gains[QS[4]]
    assert fit_detection_probability(gains, ap).q == QS[4]
