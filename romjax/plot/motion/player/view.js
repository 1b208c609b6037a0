// The state, and the view: what is in the middle, how large, and in space from which side.

const picture = element("picture");
const MARGIN = solid ? {left: 12, right: 12, top: 12, bottom: 12} : {left: 62, right: 14, top: data.colours ? 36 : 10, bottom: 44};
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

const dot = (axis, values, j = 0) => axis.reduce((sum, x, i) => sum + x * values[j + i], 0);
const axes = () => {  // to the right, up, and in space towards the eye
  if (!solid) return [[1, 0], [0, 1]];
  const [a, e] = [view.azimuth, view.elevation];
  return [
    [-Math.sin(a), Math.cos(a), 0],
    [-Math.sin(e) * Math.cos(a), -Math.sin(e) * Math.sin(a), Math.cos(e)],
    [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)],
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
  view.centre = axes().slice(0, 2).map((axis, i) => dot(axis, box.middle) + view.middle[i]);
};

const amid = () => [(MARGIN.left + view.width - MARGIN.right) / 2, (MARGIN.top + view.height - MARGIN.bottom) / 2];
const project = ([right, up]) => {
  const [x0, y0] = amid(), [x, y] = view.centre;
  const round = x => Math.round(20 * Math.max(-1e5, Math.min(1e5, x))) / 20;
  return (values, j) => [
    round(x0 + (dot(right, values, j) - x) * view.pixels), round(y0 - (dot(up, values, j) - y) * view.pixels),
  ];
};

