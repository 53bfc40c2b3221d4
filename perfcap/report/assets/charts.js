// Curves over frames, drawn in SVG: a click goes to the frame, a drag scrubs.

import { downloadCharts } from "./csv.js";

const SVG = "http://www.w3.org/2000/svg";
const HEIGHT = 100; // of the drawing's own units; its width is one unit a frame

/** An SVG element with attributes. */
export function drawn(tag, attributes, ...children) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

function built(tag, name, ...children) {
  const element = document.createElement(tag);
  if (name) element.className = name;
  element.append(...children);
  return element;
}

export class Chart {
  constructor(chart, data, player) {
    this.chart = chart;
    this.data = data;
    this.player = player;
    this.stacks = stacked(chart);
    this.range = niceRange([...this.stacks.flat(), ...nearLimits(chart)]);
    this.values = chart.lines.map(() => built("b", ""));
    this.plot = this.drawPlot();
    this.element = this.build();
    this.update();
  }

  build() {
    const { chart } = this;
    const head = built("div", "chart-head", built("h3", "", chart.title), this.worstButton(), this.fileButton());
    const legend = built("ul", "legend", ...chart.lines.map((line, index) => (
      built("li", `line-${index % 6}`, built("i", ""), `${line.name} `, this.values[index])
    )));
    legend.setAttribute("aria-hidden", "true");
    const scale = built("div", "scale", ...[this.range[1], this.range[0]].map((value) => built("span", "", round(value))));
    scale.setAttribute("aria-hidden", "true");
    const figure = built("figure", "chart", head, built("div", "plot", scale, this.plot), legend, built("p", "hint", chart.about));
    return figure;
  }

  /** A way to the worst frame for hands and for readers of screens. */
  worstButton() {
    const found = worst(this.chart, this.stacks);
    if (found === null) return "";
    const { first } = this.data;
    const button = built("button", "jump", `${worstText(this.chart, found.value)} at ${first + found.frame}`);
    button.type = "button";
    button.addEventListener("click", () => this.player.seek(found.frame));
    this.worst = found;
    return button;
  }

  fileButton() {
    const button = built("button", "jump", "CSV");
    button.type = "button";
    button.setAttribute("aria-label", `CSV of ${this.chart.title}`);
    button.addEventListener("click", () => downloadCharts(this.data, [this.chart], this.chart.title));
    return button;
  }

  drawPlot() {
    const { frames, marks, first } = this.data;
    const svg = drawn("svg", { viewBox: `-0.5 0 ${frames} ${HEIGHT}`, preserveAspectRatio: "none", role: "img", "aria-label": this.describe() });
    for (const mark of marks) {
      svg.append(drawn("rect", { class: `mark-${mark.kind}`, x: mark.start - first - 0.5, y: 0, width: mark.stop - mark.start, height: HEIGHT }));
    }
    for (const { value, index } of limitsOf(this.chart)) {
      if (value < this.range[0] || value > this.range[1]) continue;
      const name = index === null ? "limit" : `limit line-${index % 6}`;
      svg.append(drawn("line", { class: name, x1: -0.5, x2: frames - 0.5, y1: this.y(value), y2: this.y(value) }));
    }
    this.stacks.forEach((values, index) => svg.append(this.drawLine(values, index)));
    this.ghost = drawn("line", { class: "ghost", y1: 0, y2: HEIGHT, x1: -9, x2: -9 });
    this.cursor = drawn("line", { class: "cursor", y1: 0, y2: HEIGHT });
    svg.append(this.ghost, this.cursor);
    this.listen(svg);
    return svg;
  }

  drawLine(values, index) {
    const runs = defined(values).map((run) => run.map(([x, value]) => `${x} ${this.y(value)}`));
    const name = `line-${index % 6}`;
    if (!this.chart.stacked) {
      return drawn("path", { class: name, d: runs.map((run) => `M${run.length > 1 ? run.join("L") : `${run[0]}h0.01`}`).join("") });
    }
    const below = index > 0 ? this.stacks[index - 1] : values.map(() => 0);
    const area = defined(values).map((run) => {
      const back = [...run].reverse().map(([x]) => `${x} ${this.y(below[x])}`);
      return `M${run.map(([x, value]) => `${x} ${this.y(value)}`).join("L")}L${back.join("L")}Z`;
    });
    return drawn("path", { class: `${name} area`, d: area.join("") });
  }

  y(value) {
    const [low, high] = this.range;
    return (HEIGHT * (1 - (value - low) / (high - low))).toFixed(2);
  }

  describe() {
    const { chart } = this;
    const parts = chart.lines.map((line) => {
      const known = line.values.filter((value) => value !== null);
      if (known.length === 0) return `${line.name}: no values`;
      const mean = known.reduce((sum, value) => sum + value, 0) / known.length;
      return `${line.name}: mean ${short(mean)}, ${short(least(known))} to ${short(most(known))}${unit(chart)}`;
    });
    return `${chart.title} over frames. ${parts.join("; ")}.`;
  }

  listen(svg) {
    const frameAt = (event) => {
      const box = svg.getBoundingClientRect();
      const share = (event.clientX - box.left) / box.width;
      return Math.min(this.data.frames - 1, Math.max(0, Math.floor(share * this.data.frames)));
    };
    svg.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      svg.setPointerCapture(event.pointerId);
      this.player.pause();
      this.player.seek(frameAt(event));
    });
    svg.addEventListener("pointermove", (event) => {
      const frame = frameAt(event);
      for (const end of ["x1", "x2"]) this.ghost.setAttribute(end, frame);
      if (svg.hasPointerCapture(event.pointerId)) this.player.seek(frame);
      else this.tell(frame);
    });
    svg.addEventListener("pointerleave", () => {
      for (const end of ["x1", "x2"]) this.ghost.setAttribute(end, -9);
      this.tell(this.player.frame);
    });
  }

  /** Show the current frame. */
  update() {
    for (const end of ["x1", "x2"]) this.cursor.setAttribute(end, this.player.frame);
    this.tell(this.player.frame);
  }

  tell(frame) {
    this.chart.lines.forEach((line, index) => {
      const value = line.values[frame];
      this.values[index].textContent = value === null ? "–" : `${short(value)}${unit(this.chart)}`;
    });
  }
}

/** Lines as drawn: summed up where they are stacked. */
function stacked(chart) {
  const lines = chart.lines.map((line) => line.values);
  if (!chart.stacked) return lines;
  const sum = lines[0].map(() => 0);
  return lines.map((values) => values.map((value, frame) => {
    sum[frame] = value === null || sum[frame] === null ? null : sum[frame] + value;
    return sum[frame];
  }));
}

/** The frame where any line is highest (high), any lowest (lowest), or the last one lowest (low). */
function worst(chart, lines) {
  if (chart.worst === "limit") return nearest(chart);
  let found = null;
  const low = chart.worst.startsWith("low");
  const looked = chart.worst === "low" ? lines.slice(-1) : lines;
  for (const values of looked) {
    values.forEach((value, frame) => {
      if (value === null) return;
      const worse = found === null || (low ? value < found.value : value > found.value);
      if (worse) found = { frame, value };
    });
  }
  return found;
}

/** The frame where a line is nearest to its limits, or farthest beyond them. */
function nearest(chart) {
  let found = null;
  for (const { values, limits } of chart.lines) {
    if (!limits) continue;
    values.forEach((value, frame) => {
      if (value === null) return;
      const left = Math.min(value - limits[0], limits[1] - value);
      if (found === null || left < found.value) found = { frame, value: left };
    });
  }
  return found;
}

function worstText(chart, value) {
  if (chart.worst !== "limit") return `${chart.worst.startsWith("low") ? "lowest" : "highest"} ${short(value)}${unit(chart)}`;
  if (Math.abs(value) < 0.05) return "at its limit";
  return `${short(Math.abs(value))}${unit(chart)} ${value < 0 ? "beyond" : "from"} its limit`;
}

/** Limits of a chart, each with the number of its line; those that all lines share have none. */
function limitsOf(chart) {
  const known = chart.lines.map((line, index) => ({ limits: line.limits ?? null, index })).filter((each) => each.limits !== null);
  if (known.length === 0) return [];
  const shared = known.length === chart.lines.length && known.every(({ limits }) => limits.join() === known[0].limits.join());
  const shown = shared ? [{ limits: known[0].limits, index: null }] : known;
  return shown.flatMap(({ limits, index }) => limits.map((value) => ({ value, index })));
}

/** Those limits that are near enough to the values to be drawn with them. */
function nearLimits(chart) {
  const values = chart.lines.flatMap((line) => line.values.filter((value) => value !== null));
  if (values.length === 0) return [];
  const [low, high] = [least(values), most(values)];
  const room = 0.5 * (high - low) + 10;
  return limitsOf(chart).map(({ value }) => value).filter((value) => value > low - room && value < high + room);
}

function least(values) {
  return values.reduce((a, b) => Math.min(a, b), Infinity);
}

function most(values) {
  return values.reduce((a, b) => Math.max(a, b), -Infinity);
}

/** Runs of frames with a value, as pairs [frame, value]. */
function defined(values) {
  const runs = [];
  values.forEach((value, frame) => {
    if (value === null) return;
    if (frame === 0 || values[frame - 1] === null) runs.push([]);
    runs[runs.length - 1].push([frame, value]);
  });
  return runs;
}

/** Round numbers below and above all values. */
function niceRange(values) {
  const known = values.filter((value) => value !== null);
  if (known.length === 0) return [0, 1];
  let low = least(known);
  let high = most(known);
  if (low >= 0 && low < 0.5 * high) low = 0;
  const step = 10 ** Math.floor(Math.log10(Math.max(high - low, 1e-9 * Math.abs(high), 1e-12)));
  const fine = step / 2;
  low = Math.floor(low / fine + 1e-9) * fine;
  high = Math.ceil(high / fine - 1e-9) * fine;
  return high > low ? [low, high] : [low, low + fine];
}

/** Three digits or so. */
function short(value) {
  const size = Math.abs(value);
  if (size >= 100 || value === 0) return value.toFixed(0);
  return value.toFixed(size >= 10 ? 1 : 2);
}

/** Without zeros at the end, for scales. */
function round(value) {
  return String(Number(short(value)));
}

function unit(chart) {
  if (chart.unit === "°") return "°";
  return chart.unit ? ` ${chart.unit}` : "";
}
