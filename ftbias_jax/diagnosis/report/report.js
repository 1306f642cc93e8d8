// Values under the pointer and zoom for the plots against time. Without it the page is whole: the plots are drawn as SVG.
"use strict";
(() => {
  const SVG = "http://www.w3.org/2000/svg";
  const STYLES = ["before", "after"];

  const node = (tag, attributes, text) => {
    const made = document.createElementNS(SVG, tag);
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    if (text !== undefined) made.textContent = text;
    return made;
  };
  const shown = (x) => (x === null || x === undefined ? "?" : Number(x.toPrecision(3)).toString().replace("-", "\u2212"));

  // At most count + 1 round numbers from low to high.
  const ticks = (low, high, count) => {
    const rough = (high - low) / Math.max(count, 1);
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((factor) => factor * power).find((size) => size >= rough * (1 - 1e-9));
    const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    const made = [];
    for (let i = Math.ceil(low / step - 1e-9); i * step <= high * (1 + 1e-12) + 1e-9 * step; i++) {
      made.push([i * step, (i * step).toFixed(decimals).replace("-", "\u2212")]);
    }
    return made;
  };

  // One channel of one log: its drawing, its numbers, and the plotting area in drawing units.
  const panel = (svg, data) => {
    const [left, top, width, height] = svg.dataset.axes.split(" ").map(Number);
    const channel = Number(svg.dataset.channel);
    const of = (name) => (data[name] ? data[name][channel] : null);
    const lines = STYLES.filter((style) => data[style]).map((style) => [style, of(style)]);
    const cursor = node("g", {});
    const clip = `${svg.dataset.channel}-${svg.closest("[data-series]").dataset.series}-clip`;
    const still = [...svg.children].filter((child) => !["title", "desc"].includes(child.tagName));
    const live = node("g", {});
    svg.append(live, cursor);
    return { svg, left, top, width, height, lines, noise: of("noise"), cursor, clip, still, live };
  };

  // Draws a panel between two times; the whole log is the drawing that is there without this script.
  const draw = (one, t, [from, to], whole) => {
    one.still.forEach((child) => child.setAttribute("visibility", whole ? "visible" : "hidden"));
    one.live.replaceChildren();
    if (whole) return;
    // One sample beyond either edge, so that the lines reach the frame.
    const first = Math.max(0, t.findIndex((time) => time >= from) - 1);
    const after = t.findIndex((time) => time > to);
    const last = after < 0 ? t.length : Math.min(t.length, after + 1);
    const seen = [0];
    for (const [, y] of one.lines) for (let i = first; i < last; i++) if (y[i] !== null) seen.push(y[i]);
    for (let i = first; i < last; i++) if (one.noise[i] !== null) seen.push(2 * one.noise[i], -2 * one.noise[i]);
    const margin = 0.05 * (Math.max(...seen) - Math.min(...seen)) || 1;
    const [low, high] = [Math.min(...seen) - margin, Math.max(...seen) + margin];
    const x = (time) => one.left + (one.width * (time - from)) / (to - from);
    const y = (value) => one.top + (one.height * (high - value)) / (high - low);
    const path = (values) => {
      let steps = "";
      let pen = "M";
      for (let i = first; i < last; i++) {
        if (values(i) === null) pen = "M";
        else {
          steps += `${pen}${x(t[i]).toFixed(1)} ${y(values(i)).toFixed(1)}`;
          pen = "L";
        }
      }
      return steps;
    };
    const [right, bottom] = [one.left + one.width, one.top + one.height];
    const add = (tag, attributes, text) => one.live.append(node(tag, attributes, text));
    const area = node("clipPath", { id: one.clip });
    area.append(node("rect", { x: one.left, y: one.top, width: one.width, height: one.height }));
    one.live.append(area);
    for (const [value, words] of ticks(low, high, Math.round(one.height / 26))) {
      add("line", { x1: one.left, x2: right, y1: y(value), y2: y(value), class: "grid" });
      add("text", { x: one.left - 5, y: y(value) + 3.5, "text-anchor": "end" }, words);
    }
    add("line", { x1: one.left, x2: right, y1: bottom, y2: bottom, class: "axis" });
    for (const [value, words] of ticks(from, to, Math.round(one.width / 50))) {
      add("line", { x1: x(value), x2: x(value), y1: bottom, y2: bottom + 4, class: "axis" });
      add("text", { x: x(value), y: bottom + 15, "text-anchor": "middle" }, words);
    }
    add("text", { x: right, y: bottom + 30, "text-anchor": "end", class: "name" }, "time [s]");
    add("text", { x: 2, y: one.top - 10, class: "name" }, one.svg.dataset.name);
    const inside = { "clip-path": `url(#${one.clip})` };
    const band = [];
    for (let i = first; i < last; i++) if (one.noise[i] !== null) band.push([t[i], one.noise[i]]);
    const outline = [...band.map(([time, std]) => [time, -2 * std]), ...band.reverse().map(([time, std]) => [time, 2 * std])];
    const corners = outline.map(([time, value]) => `${x(time).toFixed(1)} ${y(value).toFixed(1)}`);
    if (corners.length) add("path", { ...inside, class: "noise", d: `M${corners.join("L")}Z` });
    for (const sign of [-2, 2]) {
      const edge = path((i) => (one.noise[i] === null ? null : sign * one.noise[i]));
      add("path", { ...inside, class: "noise-edge", d: edge });
    }
    for (const [style, values] of one.lines) {
      add("path", { ...inside, class: `line-${style}`, d: path((i) => values[i]) });
    }
  };

  // The plots of one log share the time under the pointer and the zoom.
  const connect = (grid) => {
    const data = JSON.parse(document.getElementById(grid.dataset.series).textContent);
    const t = data.t;
    if (t.length < 3) return;
    const whole = [t[0], t[t.length - 1]];
    const panels = [...grid.querySelectorAll("svg[data-axes]")].map((svg) => panel(svg, data));
    let view = whole;
    let at = null;
    let from = null;

    const bar = document.createElement("p");
    bar.className = "small tools";
    const hint = document.createElement("span");
    hint.textContent = "Point at a plot for its values, drag to zoom. Keys: arrows, plus, minus, Escape.";
    const reset = document.createElement("button");
    reset.type = "button";
    reset.textContent = "Whole log";
    reset.hidden = true;
    bar.append(hint, reset);
    grid.before(bar);

    const x = (one, time) => one.left + (one.width * (time - view[0])) / (view[1] - view[0]);
    const nearest = (time) => {
      let [low, high] = [0, t.length - 1];
      while (high - low > 1) {
        const middle = (low + high) >> 1;
        if (t[middle] <= time) low = middle;
        else high = middle;
      }
      return time - t[low] <= t[high] - time ? low : high;
    };
    const mark = () => {
      for (const one of panels) {
        one.cursor.replaceChildren();
        const bottom = one.top + one.height;
        if (from !== null && at !== null) {
          const [start, end] = [x(one, Math.min(from, at)), x(one, Math.max(from, at))];
          const chosen = { x: start, y: one.top, width: Math.max(end - start, 0), height: one.height };
          one.cursor.append(node("rect", { ...chosen, class: "chosen" }));
        }
        if (at === null) continue;
        const i = nearest(at);
        const words = one.lines.map(([style, y]) => `${style} ${shown(y[i])}`);
        const text = `${t[i].toFixed(2)} s: ${words.join(", ")}`;
        const edges = { x1: x(one, t[i]), x2: x(one, t[i]), y1: one.top, y2: bottom };
        one.cursor.append(node("line", { ...edges, class: "cursor" }));
        one.cursor.append(node("text", { x: 2, y: bottom + 30 }, text));  // beside the name of the time axis
      }
    };
    const zoom = (start, end) => {
      const shortest = 3 * ((whole[1] - whole[0]) / (t.length - 1));
      const middle = (start + end) / 2;
      const half = Math.max(end - start, shortest) / 2;
      view = [Math.max(whole[0], middle - half), Math.min(whole[1], middle + half)];
      const all = view[0] <= whole[0] && view[1] >= whole[1];
      panels.forEach((one) => draw(one, t, view, all));
      reset.hidden = all;
      mark();
    };
    const time = (one, event) => {
      const box = one.svg.getBoundingClientRect();
      const units = ((event.clientX - box.left) / box.width) * one.svg.viewBox.baseVal.width;
      const share = Math.min(1, Math.max(0, (units - one.left) / one.width));
      return view[0] + share * (view[1] - view[0]);
    };

    for (const one of panels) {
      one.svg.setAttribute("tabindex", "0");
      one.svg.addEventListener("pointermove", (event) => {
        at = time(one, event);
        mark();
      });
      one.svg.addEventListener("pointerdown", (event) => {
        if (event.button !== 0 || event.pointerType === "touch") return;
        from = time(one, event);
        one.svg.setPointerCapture(event.pointerId);
      });
      one.svg.addEventListener("pointerup", (event) => {
        const [start, end] = [from, time(one, event)];
        from = null;
        const share = Math.abs(end - start) / (view[1] - view[0]);
        if (start !== null && share > 0.02) zoom(Math.min(start, end), Math.max(start, end));
        else mark();
      });
      one.svg.addEventListener("pointerleave", () => {
        if (from === null) at = null;
        mark();
      });
      one.svg.addEventListener("dblclick", () => zoom(...whole));
      one.svg.addEventListener("keydown", (event) => {
        const middle = at === null ? (view[0] + view[1]) / 2 : at;
        const span = view[1] - view[0];
        if (event.key === "ArrowLeft") at = Math.max(view[0], middle - span / 50);
        else if (event.key === "ArrowRight") at = Math.min(view[1], middle + span / 50);
        else if (event.key === "+" || event.key === "=") zoom(middle - span / 4, middle + span / 4);
        else if (event.key === "-") zoom(middle - span, middle + span);
        else if (event.key === "Escape") zoom(...whole);
        else return;
        event.preventDefault();
        mark();
      });
    }
    reset.addEventListener("click", () => zoom(...whole));
  };

  document.querySelectorAll("[data-series]").forEach(connect);
})();
