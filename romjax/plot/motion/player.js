// Plays a moving mechanism: decodes its points, draws them as SVG, answers mouse and keys.
"use strict";
(() => {
const data = JSON.parse(document.getElementById("data").textContent);
const element = id => document.getElementById(id);
const picture = element("picture");
const solid = data.dimension === 3;
const MARGIN = solid ? {left: 12, right: 12, top: 12, bottom: 12} : {left: 62, right: 14, top: 10, bottom: 44};
// From the back to the front.
const STYLES = ["ground", "track", "surface", "still", "ahead", "trace", "spring", "damper", "link", "fill", "body",
  "load", "hinge", "weld", "point"];
const SIGNS = {hinge: 3.6, weld: 3.2, point: 2.2};  // [px]
const DETAILS = new Set(["ground", "track", "surface", "spring", "damper", "link", "load"]);

// Coded numbers, as `coding.py` writes them.

const integers = text => {
  const numbers = [];
  let value = 0, place = 1;
  for (const sign of atob(text)) {
    const byte = sign.charCodeAt(0);
    value += (byte & 127) * place;
    place *= 128;
    if (byte < 128) {
      numbers.push(value % 2 ? -(value + 1) / 2 : value / 2);
      value = 0;
      place = 1;
    }
  }
  return numbers;
};

const decode = block => {
  const base = integers(block.base), shapes = integers(block.shapes), weights = integers(block.weights);
  const columns = base.length, frames = weights.length / (block.reach.length || 1);
  return {
    base: base.map(x => x * block.quantum),
    shapes: block.reach.map((reach, k) => shapes.slice(k * columns, (k + 1) * columns).map(x => x * block.quantum)),
    weights: block.reach.map((reach, k) => {
      let slope = 0, sum = 0;
      return weights.slice(k * frames, (k + 1) * frames).map(x => (sum += (slope += x)) / reach);
    }),
  };
};

const add = (values, block, frame, factor) => {  // at a frame, or between two
  const i = Math.floor(frame), share = frame - i;
  block.base.forEach((x, j) => { values[j] += factor * x; });
  block.shapes.forEach((shape, k) => {
    const course = block.weights[k], next = share ? course[i + 1] : 0;
    const weight = factor * ((1 - share) * course[i] + share * next);
    for (let j = 0; j < shape.length; j++) values[j] += weight * shape[j];
  });
};

const times = (() => {
  const block = decode(data.times);
  return Array.from({length: data.frames}, (_, i) => { const t = [0]; add(t, block, i, 1); return t[0]; });
})();
const [start, end] = [times[0], times[times.length - 1]];
const models = data.models.map((model, index) => ({
  ...model, index, shown: !data.alternatives || index === 0, traces: [],
  parts: model.parts.map(part => ({...part, move: decode(part.move), bend: part.bend && decode(part.bend)})),
}));

const pointsOf = (part, frame, scale = state.scale) => {
  const values = new Float64Array(part.move.base.length);
  add(values, part.move, frame, 1);
  if (part.bend) add(values, part.bend, frame, scale);
  return values;
};

// The state, and the view: what is in the middle, how large, and in space from which side.

const state = {t: start, playing: false, rate: data.clock.rate, scale: data.scale};
const [azimuth, elevation] = data.view ?? [0, 0];
const view = {middle: [0, 0], zoom: 1, pixels: 1, azimuth, elevation, width: 0, height: 0};
let box = null;

const frameAt = t => {
  let low = 0, high = times.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle; else high = middle;
  }
  if (high === 0) return 0;
  const frame = low + Math.min(1, Math.max(0, (t - times[low]) / (times[high] - times[low])));
  return data.smooth ? frame : Math.round(frame);
};

const axes = () => {
  if (!solid) return [[1, 0], [0, 1]];
  const [a, e] = [view.azimuth, view.elevation];
  return [
    [-Math.sin(a), Math.cos(a), 0],
    [-Math.sin(e) * Math.cos(a), -Math.sin(e) * Math.sin(a), Math.cos(e)],
  ];
};

const eachOutline = visit => {
  for (const model of models) for (const part of model.parts) for (let frame = 0; frame < data.frames; frame++) {
    const values = pointsOf(part, frame);
    let at = 0;
    for (const o of part.outlines) visit(o, values.subarray(at, at += data.dimension * o.points));
  }
};

const measure = () => {  // the box of all frames of all models, in space the ball in it, and the traces
  const d = data.dimension, low = Array(d).fill(Infinity), high = Array(d).fill(-Infinity);
  const paths = part => part.outlines.filter(o => o.style === "trace").map(o => o.path = []);
  for (const model of models) model.traces = model.parts.flatMap(paths);
  eachOutline((o, points) => {
    if (o.style === "trace") o.path.push(points);
    if (!o.endless) points.forEach((x, j) => {
      low[j % d] = Math.min(low[j % d], x);
      high[j % d] = Math.max(high[j % d], x);
    });
  });
  box = {low, high, middle: high.map((x, i) => (x + low[i]) / 2), radius: 0};
  if (solid) eachOutline((o, points) => {
    if (!o.endless) for (let j = 0; j < points.length; j += d) {
      const away = box.middle.map((x, i) => points[j + i] - x);
      box.radius = Math.max(box.radius, Math.hypot(...away));
    }
  });
};

const fit = () => {
  const {clientWidth: width, clientHeight: height} = picture;
  Object.assign(view, {width, height});
  const inside = [width - MARGIN.left - MARGIN.right, height - MARGIN.top - MARGIN.bottom];
  let size = box.high.map((x, i) => x - box.low[i]);
  const largest = Math.max(...size) || 1;
  if (solid) size = [1, 1].map(() => 2.1 * box.radius);
  else size = size.map(x => Math.max(x + 0.12 * largest, 0.3 * largest));
  view.pixels = view.zoom * Math.max(1e-9, Math.min(inside[0] / size[0], inside[1] / size[1]));
  view.centre = axes().map((axis, i) => axis.reduce((sum, x, j) => sum + x * box.middle[j], 0) + view.middle[i]);
};

const project = ([right, up]) => {
  const x0 = (MARGIN.left + view.width - MARGIN.right) / 2, y0 = (MARGIN.top + view.height - MARGIN.bottom) / 2;
  const round = x => Math.round(20 * Math.max(-1e5, Math.min(1e5, x))) / 20;
  return (values, j) => {
    let x = 0, y = 0;
    for (let i = 0; i < right.length; i++) { x += right[i] * values[j + i]; y += up[i] * values[j + i]; }
    return [round(x0 + (x - view.centre[0]) * view.pixels), round(y0 - (y - view.centre[1]) * view.pixels)];
  };
};

// Drawing.

const make = (name, attributes, parent, text) => {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  parent.append(made);
  return made;
};
const clip = make("rect", {}, make("clipPath", {id: "inside"}, picture));
const grid = make("g", {class: "grid"}, picture);
const scenery = make("g", {"clip-path": "url(#inside)"}, picture);
const paths = new Map(STYLES.flatMap(style => models.map(model => {
  const path = make("path", {class: style, style: `--model: ${model.colour}`}, scenery);
  if (["body", "trace"].includes(style) && model.dash.length) path.setAttribute("stroke-dasharray", model.dash.join(" "));
  if (style === "body") path.setAttribute("stroke-width", model.width);
  return [`${style} ${model.index}`, path];
})));

const mark = {
  hinge: ([x, y], r) => `M${x - r} ${y}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0`,
  weld: ([x, y], r) => `M${x - r} ${y - r}h${2 * r}v${2 * r}h${-2 * r}z`,
};
mark.point = mark.hinge;

const drawModel = (model, frame, details, at) => {
  const strings = Object.fromEntries(STYLES.map(style => [style, ""]));
  const line = list => list.length ? "M" + list.map(p => p.join(" ")).join("L") : "";
  if (model.shown) for (const part of model.parts) {
    const values = pointsOf(part, frame);
    let j = 0;
    for (const o of part.outlines) {
      const list = [];
      for (let i = 0; i < o.points; i++, j += data.dimension) list.push(at(values, j));
      if (o.style === "trace") strings.point += mark.point(list[0], SIGNS.point);
      else if (mark[o.style]) for (const p of list) strings[o.style] += mark[o.style](p, SIGNS[o.style]);
      else if (details || !DETAILS.has(o.style)) {
        const d = line(list) + (o.closed ? "Z" : "");
        strings[o.style] += d;
        if (o.closed && o.style === "body") strings.fill += d;
      }
    }
  }
  // Beneath exaggerated deformations, the shape without them.
  if (model.shown && details && state.scale > 1) for (const part of model.parts.filter(part => part.bend)) {
    const values = pointsOf(part, frame, 0);
    let j = 0;
    for (const o of part.outlines) {
      const list = Array.from({length: o.points}, (_, i) => at(values, j + i * data.dimension));
      j += o.points * data.dimension;
      if (o.style === "body") strings.still += line(list) + (o.closed ? "Z" : "");
    }
  }
  if (model.shown) for (const trace of model.traces) {
    const list = trace.map(p => at(p, 0)), now = Math.floor(frame);
    strings.trace += line(list.slice(0, now + 1));
    strings.ahead += line(list.slice(now));
  }
  for (const style of STYLES) paths.get(`${style} ${model.index}`).setAttribute("d", strings[style]);
};

const draw = () => {
  const frame = frameAt(state.t), at = project(axes()), first = models.find(model => model.shown);
  for (const model of models) drawModel(model, frame, model === first, at);
  const digits = Math.max(0, Math.ceil(-Math.log10((end - start || 1) / Math.max(1, data.frames))));
  const shown = data.smooth ? state.t : times[frame];
  element("time").textContent = `${data.clock.symbol} = ${shown.toFixed(digits)} ${data.clock.unit}`;
  element("scrub").value = end > start ? 1000 * (state.t - start) / (end - start) : 0;
};

const nice = least => {
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].map(x => x * power).find(x => x >= least * 0.999999);
};
const number = (x, step) => {
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return digits > 4 || Math.abs(x) >= 1e5 ? x.toExponential(1) : (x + 0).toFixed(digits);
};

const drawAxes = () => {
  const {left, right, top, bottom} = MARGIN, {width, height, pixels, centre} = view;
  grid.replaceChildren();
  Object.entries({x: left, y: top, width: Math.max(0, width - left - right), height: Math.max(0, height - top - bottom)})
    .forEach(([key, value]) => clip.setAttribute(key, value));
  const step = nice(80 / pixels);
  if (solid) {  // no axis is in the plane of the picture: a length, and where x, y and z point
    const foot = [left + 40, height - bottom - 40], [r, u] = axes();
    ["x", "y", "z"].forEach((name, i) => {
      const tip = [foot[0] + 28 * r[i], foot[1] - 28 * u[i]];
      make("path", {d: `M${foot}L${tip}`, class: "frame"}, grid);
      make("text", {x: foot[0] + 38 * r[i], y: foot[1] - 38 * u[i] + 4, "text-anchor": "middle"}, grid, name);
    });
    const x = width - right - 10, y = height - bottom - 12;
    make("path", {d: `M${x - step * pixels} ${y - 4}v4H${x}v-4`, class: "frame"}, grid);
    make("text", {x: x - step * pixels / 2, y: y - 6, "text-anchor": "middle"}, grid, `${number(step, step)} m`);
    return;
  }
  const middle = [(left + width - right) / 2, (top + height - bottom) / 2];
  [width - left - right, height - top - bottom].forEach((length, i) => {
    const half = length / 2 / pixels;
    for (let k = Math.ceil((centre[i] - half) / step); k * step <= centre[i] + half; k++) {
      const place = middle[i] + (i ? -1 : 1) * (k * step - centre[i]) * pixels;
      make("path", {d: i ? `M${left} ${place}H${width - right}` : `M${place} ${top}V${height - bottom}`}, grid);
      const where = i ? {x: left - 6, y: place + 4, "text-anchor": "end"}
        : {x: place, y: height - bottom + 17, "text-anchor": "middle"};
      make("text", where, grid, number(k * step, step));
    }
  });
  make("path", {d: `M${left} ${top}V${height - bottom}H${width - right}`, class: "frame"}, grid);
  make("text", {x: middle[0], y: height - 8, "text-anchor": "middle"}, grid, "x [m]");
  make("text", {transform: `translate(14 ${middle[1]}) rotate(-90)`, "text-anchor": "middle"}, grid, "y [m]");
};

const show = () => { fit(); drawAxes(); draw(); };

// Controls.

const play = playing => {
  state.playing = playing && data.frames > 1;
  element("play").textContent = state.playing ? "❚❚" : "▶";
  element("play").setAttribute("aria-label", state.playing ? "pause" : "play");
  let last = null;
  const advance = now => {
    if (!state.playing || last === undefined) return;
    if (last !== null) state.t += (now - last) / 1000 * state.rate;
    last = now;
    if (state.t > end) state.t = start;
    draw();
    play.next = requestAnimationFrame(advance);
  };
  cancelAnimationFrame(play.next);
  if (state.playing) play.next = requestAnimationFrame(advance);
};
const go = t => { play(false); state.t = Math.min(end, Math.max(start, t)); draw(); };
const step = by => go(times[Math.min(data.frames - 1, Math.max(0, Math.round(frameAt(state.t)) + by))]);

const speed = element("speed");
const rates = Array.from({length: 17}, (_, k) => k - 9).flatMap(power => [1, 2, 5].map(x => x * 10 ** power));
for (const factor of data.clock.unit === "s" ? rates.map(x => x / data.clock.rate) : [0.1, 0.2, 0.5, 1, 2, 5]) {
  if (factor < 0.0099 || factor > 101) continue;
  const rate = Number((factor * data.clock.rate).toPrecision(6));
  const label = data.clock.unit === "s" ? `${rate} × real time` : `${rate} ${data.clock.unit}/s`;
  speed.append(new Option(label, rate, false, Math.abs(factor - 1) < 1e-6));
}
speed.onchange = () => { state.rate = Number(speed.value); };
const faster = by => {
  speed.selectedIndex = Math.min(speed.length - 1, Math.max(0, speed.selectedIndex + by));
  speed.onchange();
};
element("play").onclick = () => play(!state.playing);
element("scrub").oninput = event => go(start + (end - start) * event.target.value / 1000);
if (data.scales.length) {
  const slider = element("scale");
  slider.max = data.scales.length - 1;
  slider.value = data.scales.indexOf(data.scale);
  const label = () => { element("factor").textContent = `× ${state.scale}`; };
  slider.oninput = () => { state.scale = data.scales[slider.value]; label(); measure(); show(); };
  label();
}
element("controls").hidden = data.frames < 2;
element("deformation").hidden = !data.scales.length;

const legend = element("legend");
const buttons = models.filter(model => model.name).map(model => {
  const button = document.createElement("button");
  const sample = make("svg", {width: 34, height: 10, viewBox: "0 0 34 10"}, button);
  const path = make("path", {d: "M1 5H33", class: "body", style: `--model: ${model.colour}`, "stroke-width": model.width}, sample);
  if (model.dash.length) path.setAttribute("stroke-dasharray", model.dash.join(" "));
  button.append(model.name);
  button.onclick = () => {
    if (data.alternatives) models.forEach(other => { other.shown = other === model; });
    else model.shown = !model.shown;
    press();
    draw();
  };
  legend.append(button);
  return [button, model];
});
legend.classList.toggle("alternatives", data.alternatives);
const press = () => buttons.forEach(([button, model]) => button.setAttribute("aria-pressed", model.shown));
press();

const reset = () => { Object.assign(view, {middle: [0, 0], zoom: 1, azimuth, elevation}); show(); };
const zoom = by => { view.zoom *= by; show(); };
const keys = {
  " ": () => play(!state.playing), ArrowRight: () => step(1), ArrowLeft: () => step(-1),
  ArrowUp: () => faster(1), ArrowDown: () => faster(-1), Home: () => go(start), End: () => go(end),
  "+": () => zoom(1.25), "-": () => zoom(0.8), "0": reset,
};
document.addEventListener("keydown", event => {
  const own = event.target.matches?.("select, #scale") && event.key !== " ";
  if (!keys[event.key] || own || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  keys[event.key]();
});
picture.addEventListener("wheel", event => {
  if (!event.ctrlKey) return;  // else the page scrolls
  event.preventDefault();
  zoom(Math.exp(-0.01 * event.deltaY));
}, {passive: false});
picture.addEventListener("dblclick", reset);
picture.addEventListener("pointerdown", () => {
  const move = event => {
    if (solid && !event.shiftKey) {
      view.azimuth -= 0.01 * event.movementX;
      view.elevation = Math.max(-1.57, Math.min(1.57, view.elevation + 0.01 * event.movementY));
    } else {
      view.middle[0] -= event.movementX / view.pixels;
      view.middle[1] += event.movementY / view.pixels;
    }
    show();
  };
  window.addEventListener("pointermove", move);
  window.addEventListener("pointerup", () => window.removeEventListener("pointermove", move), {once: true});
});

measure();
show();
new ResizeObserver(show).observe(picture);
const asked = /[#&]t=([-+.\deE]+)/.exec(location.hash);
if (asked) go(Number(asked[1])); else play(data.playing && !matchMedia("(prefers-reduced-motion: reduce)").matches);
})();
