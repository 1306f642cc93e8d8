"""Figure of the experiment: a run with contact, innovations, predictions and intervals."""

import numpy as np
from matplotlib.figure import Figure
from predict import measured_bias

COLORS = {
    "default": "#0072B2",
    "default, prior of the training log": "#56B4E9",
    "as stated": "#D55E00",
    "constant calibration": "#000000",
    "held tare": "#999999",
}
FORCES = ("fx", "fy", "fz")
AXES = (*FORCES, "tx", "ty", "tz")


def draw(scored, results):
    figure = Figure(figsize=(10, 7), layout="constrained")
    (contact, innovations), (predictions, intervals) = figure.subplots(2, 2)
    _contact(contact, scored["kuka"]["contact"], results["kuka contact"])
    _innovations(innovations, scored["abb"]["NIS"])
    _predictions(predictions, scored["panda"])
    _intervals(intervals, scored["coverage"])
    return figure


def _contact(ax, scored, result):
    t = result.t - result.t[0]
    y = measured_bias(result)
    ax.plot(t, y[:, 2], color="0.75", linewidth=0.6, label="measured fz")
    ax.plot(t, result.bias[:, 2], color="#0072B2", label="filtered fz")
    ax.axhline(
        scored["measured bias at rest"][2], color="black", linestyle=":", linewidth=1, label="at rest, at the end"
    )
    for low, high in scored["contacts [s]"]:
        ax.axvspan(low, high, color="#E69F00", alpha=0.2, label="contact found")
    ax.set(title="KUKA with vibration and contact: bias [N]", xlabel="time [s]")
    ax.legend(fontsize=7)


def _innovations(ax, scored):
    for number, (name, color) in enumerate((("unseen blocks", "#0072B2"), ("as stated", "#D55E00"))):
        for rows, marker in (("slowest tenth", "o"), ("fastest tenth", "^")):
            place = np.arange(6) + 0.2 * (number - 0.5)
            ax.plot(place, scored[rows][name], marker, color=color, label=f"{name}, {rows}")
    ax.axhspan(0.8, 1.25, color="0.9")
    ax.set_yscale("log")
    ax.set_xticks(range(6), AXES)
    ax.set(title="ABB: normalised innovation squared")
    ax.set_ylim(top=60)
    ax.legend(fontsize=7, loc="upper center", ncols=2)


def _predictions(ax, scored):
    groups = [(name, ahead) for name in scored for ahead in ("1 s", "10 s")]
    for number, (kind, color) in enumerate(COLORS.items()):
        for place, (name, ahead) in enumerate(groups):
            values = scored[name][ahead]["rms"][kind][:3]
            x = 4 * place + np.arange(3) + 0.17 * (number - 2)
            ax.bar(x, values, 0.17, color=color, label=kind if place == 0 else None)
    places = [4 * i + j for i in range(len(groups)) for j in range(3)]
    ax.set_xticks(places, FORCES * len(groups), fontsize=7)
    for place, (name, ahead) in enumerate(groups):
        words = f"{name.split(', ')[1]},\n{ahead} ahead"
        ax.text(4 * place + 1, 0.98, words, transform=ax.get_xaxis_transform(), ha="center", va="top", fontsize=7)
    ax.set_ylim(top=1.6 * ax.get_ylim()[1])
    ax.set(title="Panda: error of the predicted reading, rms [N]")
    ax.legend(fontsize=6, loc="upper center", bbox_to_anchor=(0.5, 0.89), ncols=3)


def _intervals(ax, scored):
    ax.axhspan(0.9, 0.98, color="0.9")
    ax.axhline(0.95, color="black", linewidth=0.8)
    names = list(scored["1 s"]["by log and axis"])
    for ahead, marker, color in (("1 s", "o", "#0072B2"), ("10 s", "^", "#D55E00")):
        for name, shares in scored[ahead]["by log and axis"].items():
            place = names.index(name) + (-0.15 if ahead == "1 s" else 0.15)
            first = name == next(iter(scored[ahead]["by log and axis"]))
            ax.plot([place] * 6, shares, marker, color=color, markersize=4, label=f"{ahead} ahead" if first else None)
    ax.set_xticks(range(len(names)), names, fontsize=7, rotation=20)
    ax.set(title="Share of readings in their 95 % interval, by axis")
    ax.legend(fontsize=7)
