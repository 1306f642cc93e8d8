import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
from pages import Page

from ftbias_jax.diagnosis.report.html import to_html
from ftbias_jax.diagnosis.report.svg import binned_means, data_range, escape, thin, tick_words, ticks
from ftbias_jax.diagnosis.result import Where


def test_the_verdict_comes_first_and_the_sections_in_order(make_diagnosis):
    page = Page(to_html(make_diagnosis(), "a log"))
    assert page.tags.index("h1") < page.tags.index("h2")
    assert page.headings == [
        "What to do",
        "Causes",
        "The gap before and after",
        "Residual against time",
        "What is left, against the cause",
        "How well each effect explains it",
        "Twins: what the data do not tell apart",
        "Where the gap is",
        "What was not tested",
        "How to read this",
    ]
    assert page.tags.count("svg") == 1 + 6 + 1 + 1 + 1
    for words in ("The tool weighs 0.81 kg.", "0.8134 ± 0.0041 kg", "98 ± 1 %", "turn the wrist", "Weigh the tool."):
        assert words in page.text


def test_nothing_is_loaded(make_diagnosis):
    html = to_html(make_diagnosis(), "a log")
    page = Page(html)
    assert not {"link", "img", "iframe", "object", "use", "image"} & set(page.tags)
    assert not [name for name, _ in page.attributes if name.startswith("on") or name in ("src", "href", "xlink:href")]
    assert set(re.findall(r"url\((.)", html)) == {"#"}  # links within the page
    assert "@import" not in html
    assert set(re.findall(r"https?://[^\"]*", html)) == {"http://www.w3.org/2000/svg"}  # a namespace, not an address
    assert "default-src 'none'" in html


def test_hostile_text_stays_text_everywhere(make_diagnosis, make_candidate):
    evil = "\"'><script>alert(1)</script>&\x00\x1b\udcff"
    cause = make_candidate(
        evil,
        stage=evil,
        parameters={evil: 1.0},
        explanation=evil,
        remedy=evil,
        indistinguishable_from=(evil,),
        separate_by=(evil,),
    )
    base = make_diagnosis(logs=2)
    series = tuple(one._replace(regressor_name=evil) for one in base.series)
    where = Where((evil,), {evil: 1.0}, (), (), ())
    diagnosis = base._replace(
        sentence=evil,
        causes=(cause,),
        candidates=(cause,),
        where=where,
        not_tested=((evil, evil),),
        logs=(evil, evil),
        series=series,
    )
    html = to_html(diagnosis, evil)
    assert "alert(1)</script>" not in html
    assert Page(html).tags.count("script") == html.count("<script") == 3  # of the page, and numbers of two logs
    assert "\x00" not in html
    html.encode()


@pytest.mark.parametrize("verdict", ["none", "unknown"])
def test_without_a_cause_there_is_no_after(make_diagnosis, verdict):
    page = Page(to_html(make_diagnosis(verdict=verdict, causes=()), "a log"))
    assert "Causes" not in page.headings
    assert "What is left, against the cause" not in page.headings
    assert not [value for _, value in page.attributes if value in ("line-after", "key after")]
    assert ("Where the gap is" in page.headings) == (verdict == "unknown")


def test_drawings_speak_to_screen_readers(make_diagnosis):
    page = Page(to_html(make_diagnosis(logs=2), "a log"))
    ids = [value for name, value in page.attributes if name == "id" and not value.startswith("series-")]
    assert len(ids) == len(set(ids))
    named = [value for name, value in page.attributes if name == "aria-labelledby"]
    assert len(named) == page.tags.count("svg")
    assert {part for names in named for part in names.split()} == set(ids)


@pytest.mark.parametrize(("logs", "bins"), [(1, 100_000), (8, 3000)])
def test_the_file_stays_small(make_diagnosis, make_candidate, logs, bins):
    candidates = tuple(make_candidate(f"effect_{i}", 2.0 - 0.1 * i) for i in range(30))
    html = to_html(make_diagnosis(logs=logs, bins=bins, candidates=candidates), "a log")
    assert len(html.encode()) < 600_000  # drawings, and numbers for the pointer


@pytest.mark.parametrize("bins", [0, 1, 3])
def test_short_empty_and_unmeasured_series_still_make_a_page(make_diagnosis, bins):
    base = make_diagnosis(bins=5)
    series = base.series[0]._replace(
        **{name: getattr(base.series[0], name)[:bins] for name in ("t", "before", "after", "noise", "regressor")}
    )
    nothing = np.full(6, np.nan)
    gap = base.gap._replace(before_rms=nothing, noise_floor=np.zeros(6), before_sigmas=float("nan"))
    html = to_html(base._replace(series=(series,), gap=gap, candidates=()), "a log")
    assert "nan," not in re.sub(r"<desc.*?</desc>", "", html)
    Page(html)


def test_thinning_keeps_every_peak():
    t = np.arange(10_000.0)
    y = np.zeros(10_000)
    y[[17, 5003]] = [8.0, -9.0]
    y[600:900] = np.nan
    thin_t, thin_y = thin(t, y, 100)
    assert len(thin_t) <= 200
    assert (np.diff(thin_t) > 0).all()
    assert np.nanmax(thin_y) == 8
    assert np.nanmin(thin_y) == -9
    assert np.isnan(thin_y).any()


def test_binned_means_follow_the_line():
    rng = np.random.default_rng(1)
    x = rng.uniform(-1, 1, 4000)
    y = 3 * x + rng.normal(size=4000)
    y[::7] = np.nan
    middles, means, errors = binned_means(x, y, 10)
    assert len(middles) == 10
    assert (np.abs(means - 3 * middles) < 4 * errors).all()


def test_ticks_are_round_inside_and_readable():
    assert np.allclose(ticks(-0.31, 0.52, 5), [-0.2, 0.0, 0.2, 0.4])
    assert [tick_words(x, [-0.2, 0.0, 0.2]) for x in (-0.2, 0.0, 0.2)] == ["\N{MINUS SIGN}0.2", "0", "0.2"]
    assert tick_words(2e-7, [0.0, 2e-7]) == "2e\N{MINUS SIGN}07"
    assert data_range(np.array([np.nan, np.inf])) == (-1, 1)
    low, high = data_range(np.array([5.0, 5.0]))
    assert low < 5 < high
    assert escape("<a\x07") == "&lt;a\N{REPLACEMENT CHARACTER}"


def test_the_report_and_the_json_say_where_it_comes_from(tmp_path, make_diagnosis):
    log = {"name": "log.npz", "sha256": "ab" * 32, "date": None, "duration": 3.0, "rate": 100.0, "samples": 300}
    origin = {"version": "9.9", "robot": "panda", "setup": {"name": "s.toml", "sha256": "cd" * 32}, "urdf": None}
    origin |= {"logs": [log], "options": {"without": ["gain"]}}
    diagnosis = make_diagnosis(provenance=origin)
    text = to_html(diagnosis, "title")
    for words in ("9.9", "panda", "s.toml", "ab" * 32, "cd" * 32, "300 samples", "without"):
        assert words in text
    diagnosis.to_json(tmp_path / "out.json")
    assert json.loads((tmp_path / "out.json").read_text())["provenance"] == origin


def test_the_advice_is_a_command_with_the_users_own_paths(make_diagnosis):
    named = to_html(make_diagnosis(setup_name="my setup.toml", logs=1), "a log")
    assert (
        "ftbias diagnose log_0.npz --setup &#x27;my setup.toml&#x27; --apply -o &#x27;my setup_fixed.toml&#x27;"
        in named
    )
    typed = make_diagnosis(setup_name="s.toml", command="ftbias diagnose runs/a.npz --setup cell/s.toml")
    assert "ftbias diagnose runs/a.npz --setup cell/s.toml --apply -o s_fixed.toml" in to_html(typed, "a log")


def test_the_number_of_the_joint_stands_with_every_effect_of_one(make_diagnosis, make_candidate):
    cause = make_candidate("encoder_offset", parameters={"joint": 4, "offset": 0.01}, units={"joint": "1"})
    html = to_html(make_diagnosis(causes=(cause,), candidates=(cause,)), "a log")
    assert html.count("encoder_offset (joint 4)") == 5  # cause, remedy, plot with its description, table


def test_the_plot_against_the_cause_has_the_bias_refitted(make_diagnosis):
    base = make_diagnosis()
    [series] = base.series
    flat = base._replace(series=(series._replace(before=series.after, refitted=series.before),))
    plots = [
        re.search(r'<svg[^>]*aria-labelledby="regressor-t.*?</svg>', to_html(d, "a log"), re.S)[0] for d in (base, flat)
    ]
    assert plots[0] == plots[1]


def test_the_ranking_shows_differences_to_the_best_and_the_term_that_was_found(make_diagnosis, make_candidate):
    best = make_candidate("gain", 1122.0, held_out_gain_stderr=157.0, behind=0.0, behind_stderr=0.0)
    near = make_candidate("tool_mass", 1121.0, held_out_gain_stderr=157.0, behind=1.2, behind_stderr=1.9)
    term = SimpleNamespace(
        drive="velocity", held_out_gain=1200.0, held_out_gain_stderr=150.0, check="look", text="a force", resembles=(),
        equivalent_to=(), separate_by=(), coefficients={}, stderr={}, parameters={}, parameters_stderr={}, point=None,
        curve=None,
    )  # fmt: skip
    page = Page(to_html(make_diagnosis(candidates=(best, near), causes=(near,), terms=(term,)), "a log"))
    assert "● term: velocity" in page.text
    assert "-1.2 ± 1.9" in page.text
    assert "1121 ± 157" in page.text  # a row of the table
    assert page.text.index("● term: velocity") < page.text.index("● tool_mass")
