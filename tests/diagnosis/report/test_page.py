import base64
import hashlib
import json
import re

import numpy as np
import pytest

from ftbias_jax.diagnosis.report.html import to_html
from ftbias_jax.diagnosis.report.page import averaged, data_block, policy, script
from ftbias_jax.diagnosis.result import Series


def series_of(bins, seed=0):
    rng = np.random.default_rng(seed)
    before, after = rng.normal(size=(2, bins, 6))
    return Series(np.arange(float(bins)), before, after, np.full((bins, 6), 0.5), rng.normal(size=bins), "load [N]")


def scripts(html):
    return re.findall(r"<script>(.*?)</script>", html, re.S)


def test_only_the_reports_own_script_may_run(make_diagnosis):
    html = to_html(make_diagnosis(), "a log")
    [text] = scripts(html)
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    assert f"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{digest}'\"" in html
    assert "</" not in script()


def test_without_plots_against_time_there_is_no_script(make_diagnosis):
    html = to_html(make_diagnosis(series=()), "a log")
    assert scripts(html) == []
    assert "script-src" not in html
    assert policy("") == "default-src 'none'; style-src 'unsafe-inline'"


@pytest.mark.parametrize("with_after", [True, False])
def test_the_numbers_of_the_plots_are_in_the_page_in_four_digits(with_after):
    series = series_of(7)
    series.before[3, 2] = np.nan
    block = data_block(series, "series-0", with_after)
    found = json.loads(re.fullmatch(r'<script type="application/json" id="series-0">(.*)</script>', block)[1])
    assert found.keys() == {"t", "before", "after", "noise"} - (set() if with_after else {"after"})
    assert found["before"][2][3] is None
    read = np.array(found["before"], float).T
    np.testing.assert_allclose(read, series.before, rtol=5e-4)
    assert found["t"] == series.t.tolist()


def test_long_series_are_means_of_neighbours_and_their_noise_is_that_of_means():
    series = series_of(1000)
    series.before[:4, 0] = np.nan
    short = averaged(series, 250)
    np.testing.assert_allclose(short.t, series.t.reshape(250, 4).mean(1))
    np.testing.assert_allclose(short.after, series.after.reshape(250, 4, 6).mean(1))
    np.testing.assert_allclose(short.noise, 0.5 / 2)
    assert np.isnan(short.before[0, 0])
    np.testing.assert_allclose(short.before[1:, 0], series.before[4:, 0].reshape(249, 4).mean(1))
    assert averaged(series, 1000) is series
