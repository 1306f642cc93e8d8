"""Figures: what is drawn, and the formats in which they are saved."""

import builtins
from dataclasses import replace

import numpy as np
import pytest

from ftbias_jax.errors import OutputError
from ftbias_jax.filtering.quality import plot
from ftbias_jax.filtering.result import ARRAYS, Filtered

COUNT = 300


@pytest.fixture
def filtered():
    """A result that settles within ten samples; one axis was never measured."""
    rng = np.random.default_rng(0)
    fields = {name: rng.normal(size=(COUNT, 6)) for name in ARRAYS}
    fields["t"] = 100 + np.arange(COUNT) / 50
    fields["bias_std"] = np.ones((COUNT, 6))
    fields["used"] = np.ones(COUNT, bool)
    fields["bias_std"][:10] = 1000
    fields["wrench_unbiased"][:, 4] = np.nan
    return Filtered(**fields)


def test_a_panel_an_axis_with_bias_and_residual_once_the_bias_is_known(filtered):
    truth = np.full((COUNT, 6), 7.0)
    figure = plot.plot_filtered(filtered, "a title", truth)
    assert figure.get_suptitle() == "a title"
    panels = np.array(figure.axes).reshape(2, 2, 3)  # force or torque, bias or residual, axis
    assert [panel.get_xlabel() for panel in figure.axes] == [""] * 9 + ["time [s]"] * 3
    residual = filtered.wrench_unbiased - filtered.wrench_tool
    for channel in range(6):
        above, below = panels[channel // 3, :, channel % 3]
        unit = "N" if channel < 3 else "Nm"
        assert (above.get_ylabel(), below.get_ylabel()) == (f"bias [{unit}]", f"residual [{unit}]")
        assert above.get_title() == f"Bias, {'force' if channel < 3 else 'torque'} {'xyz'[channel % 3]}"
        lines = {line.get_label(): line.get_ydata() for line in (*above.get_lines(), *below.get_lines())}
        np.testing.assert_array_equal(lines["truth"], truth[10:, channel])
        np.testing.assert_array_equal(lines["bias"], filtered.bias[10:, channel])
        np.testing.assert_array_equal(lines["used"], residual[10:, channel])
        noise = np.hypot(filtered.reading_std, filtered.bias_std)[10:, channel]
        np.testing.assert_allclose(lines["± 2 std of noise"], 2 * noise)
        [band] = above.collections
        np.testing.assert_allclose(band.get_datalim(above.transData).y1, filtered.bias[10:, channel].max() + 2)
    legends = [[text.get_text() for text in panel.get_legend().get_texts()] for panel in panels[0, :, 0]]
    assert legends == [["truth", "bias", "± 2 std"], ["used", "± 2 std of noise"]]


def test_samples_that_were_not_used_are_marked(filtered):
    used = np.arange(COUNT) % 3 > 0
    figure = plot.plot_filtered(replace(filtered, used=used), "a title")
    lines = {line.get_label(): line for line in figure.axes[3].get_lines()}
    residual = (filtered.wrench_unbiased - filtered.wrench_tool)[:, 0]
    np.testing.assert_array_equal(lines["not used"].get_ydata(), residual[10:][~used[10:]])
    assert np.isnan(lines["used"].get_ydata()).sum() == (~used[10:]).sum()


def test_long_logs_are_thinned(filtered, monkeypatch):
    monkeypatch.setattr(plot, "MAX_POINTS", 100)
    line = plot.plot_filtered(filtered, "").axes[0].get_lines()[0]
    np.testing.assert_array_equal(line.get_ydata(), filtered.bias[10::2, 0])


def test_the_format_follows_the_suffix(filtered, tmp_path):
    figure = plot.plot_filtered(filtered, "a title")
    for name, start in (("out.PNG", b"\x89PNG"), ("out.svg", b"<?xml"), ("out.pdf", b"%PDF")):
        plot.save_figure(str(tmp_path / name), figure)
        assert (tmp_path / name).read_bytes().startswith(start)
    for name in ("other.bmp", "other"):
        with pytest.raises(OutputError, match=r"cannot draw .*end the name in .png, .svg or .pdf"):
            plot.save_figure(str(tmp_path / name), figure)
        assert not (tmp_path / name).exists()


def test_without_matplotlib_the_extra_is_named(filtered, monkeypatch):
    real = builtins.__import__

    def absent(name, *rest):
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", absent)
    with pytest.raises(OutputError, match=r"not installed \(pip install 'ftbias-jax\[plot\]'\)"):
        plot.plot_filtered(filtered, "a title")
