// The mechanism as SVG: one path for each style of each model, and in space its solids.

// From the back to the front.
const STYLES = ["ground", "track", "surface", "still", "ahead", "trace", "spring", "damper", "link", "fill", "body",
  "load", "hinge", "weld", "point"];
const SIGNS = {hinge: 3.6, weld: 3.2, point: 2.2};  // [px]
const DETAILS = new Set(["ground", "track", "surface", "spring", "damper", "link", "load"]);

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
const solids = make("g", {}, scenery);
const paths = new Map(STYLES.flatMap(style => models.map(model => {
  const path = make("path", {class: style, style: `--model: ${model.colour}`}, scenery);
  if (["body", "trace"].includes(style) && model.dash.length) path.setAttribute("stroke-dasharray", model.dash.join(" "));
  if (style === "body") path.setAttribute("stroke-width", model.width);
  return [`${style} ${model.index}`, path];
})));
scenery.insertBefore(solids, paths.get("fill 0"));
const coloured = make("g", {}, scenery);
scenery.insertBefore(coloured, paths.get("load 0"));

const mark = {
  hinge: ([x, y], r) => `M${x - r} ${y}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0`,
  weld: ([x, y], r) => `M${x - r} ${y - r}h${2 * r}v${2 * r}h${-2 * r}z`,
};
mark.point = mark.hinge;

const line = list => list.length ? "M" + list.map(p => p.join(" ")).join("L") : "";

const drawModel = (model, frame, details, at) => {
  const strings = Object.fromEntries(STYLES.map(style => [style, ""])), strokes = [];
  if (model.shown) for (const part of model.parts) {
    const values = pointsOf(part, frame), numbers = part.values && valuesOf(part.values, frame);
    let j = 0, k = 0;
    for (const o of part.outlines) {
      const list = [], first = j, colours = o.coloured && numbers.subarray(k, k += o.points);
      for (let i = 0; i < o.points; i++, j += data.dimension) list.push(at(values, j));
      if (o.style === "trace") strings.point += mark.point(list[0], SIGNS.point);
      else if (mark[o.style]) for (const p of list) strings[o.style] += mark[o.style](p, SIGNS[o.style]);
      else if (solid && details && o.style === "body") addSolid(o, list, values.subarray(first, j), colours);
      else if (details || !DETAILS.has(o.style)) {
        const d = line(list) + (o.closed ? "Z" : "");
        strings[o.style] += d;
        if (o.closed && o.style === "body") strings.fill += d;
        if (colours) inColours(list, colours).forEach(([d, colour]) => strokes.push([d, "coloured", colour]));
      }
    }
  }
  if (details) paint(coloured, strokes, model);
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
  drawSolids(first);
  const digits = Math.max(0, Math.ceil(-Math.log10((end - start || 1) / Math.max(1, data.frames))));
  const shown = data.smooth ? state.t : times[frame];
  element("time").textContent = `${data.clock.symbol} = ${shown.toFixed(digits)} ${data.clock.unit}`;
  moveCursors(frame);
  element("scrub").value = end > start ? 1000 * (state.t - start) / (end - start) : 0;
};
