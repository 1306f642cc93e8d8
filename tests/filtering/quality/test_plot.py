"""Figures: what is drawn, and that the files decode."""

import builtins

import numpy as np
import pytest
from matplotlib.image import imread

from ftbias_jax.errors import OutputError
from ftbias_jax.filtering.quality import plot
from ftbias_jax.filtering.result import Filtered

COUNT = 300


@pytest.fixture
def filtered():
    """Settled after the first ten samples; one axis was never measured."""
    rng = np.random.default_rng(0)
    fields = {name: rng.normal(size=(COUNT, 6)) for name in Filtered._fields}
    fields["t"] = 100 + np.arange(COUNT) / 50
    fields["bias_std"] = np.ones((COUNT, 6))
    fields["bias_std"][:10] = 1000
    fields["wrench_unbiased"][:, 4] = np.nan
    return Filtered(**fields)


def test_bias_with_its_band_and_residual_once_the_bias_is_known(filtered):
    truth = np.full((COUNT, 6), 7.0)
    figure = plot.plot_filtered(filtered, "a title", truth)
    assert figure.get_suptitle() == "a title"
    (force, torque), (force_residual, torque_residual) = np.array(figure.axes).reshape(2, 2)
    assert [ax.get_ylabel() for ax in (force, torque)] == ["bias [N]", "bias [Nm]"]
    assert [ax.get_xlabel() for ax in (force_residual, torque_residual)] == ["time [s]"] * 2
    for ax, column in ((force, 0), (torque, 3)):
        lines = {line.get_label(): line for line in ax.get_lines()}
        np.testing.assert_array_equal(lines["truth"].get_ydata(), truth[10:, column])
        for i, axis in enumerate("xyz"):
            np.testing.assert_allclose(lines[axis].get_xdata(), filtered.t[10:] - 100)
            np.testing.assert_array_equal(lines[axis].get_ydata(), filtered.bias[10:, column + i])
            band = ax.collections[i].get_datalim(ax.transData)
            np.testing.assert_allclose(band.y1, filtered.bias[10:, column + i].max() + 2)
        assert [text.get_text() for text in ax.get_legend().get_texts()] == ["truth", "x", "y", "z"]
    residual = (filtered.wrench_unbiased - filtered.wrench_tool)[10:]
    for i in range(3):
        np.testing.assert_array_equal(torque_residual.get_lines()[i].get_ydata(), residual[:, 3 + i])


def test_long_logs_are_thinned(filtered, monkeypatch):
    monkeypatch.setattr(plot, "MAX_POINTS", 100)
    line = plot.plot_filtered(filtered, "").axes[0].get_lines()[0]
    np.testing.assert_array_equal(line.get_ydata(), filtered.bias[10::2, 0])


def test_a_png_decodes_and_is_not_blank(filtered, tmp_path):
    plot.save_figure(str(tmp_path / "out.PNG"), plot.plot_filtered(filtered, "a title"))
    pixels = imread(tmp_path / "out.PNG", format="png")
    assert pixels.shape[:2] == (975, 1650)
    assert pixels[:, :, :3].std() > 0.05


@pytest.mark.parametrize(("name", "start"), [("out.svg", b"<?xml"), ("out.pdf", b"%PDF")])
def test_the_format_follows_the_suffix(filtered, tmp_path, name, start):
    plot.save_figure(str(tmp_path / name), plot.plot_filtered(filtered, "a title"))
    assert (tmp_path / name).read_bytes().startswith(start)


@pytest.mark.parametrize("name", ["out.bmp", "out"])
def test_other_formats_are_refused(tmp_path, name):
    with pytest.raises(OutputError, match=r"cannot draw .*end the name in .png, .svg or .pdf"):
        plot.save_figure(str(tmp_path / name), None)
    assert list(tmp_path.iterdir()) == []


def test_without_matplotlib_the_extra_is_named(filtered, monkeypatch):
    real = builtins.__import__

    def absent(name, *rest):
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", absent)
    with pytest.raises(OutputError, match=r"not installed \(pip install 'ftbias-jax\[plot\]'\)"):
        plot.plot_filtered(filtered, "a title")
