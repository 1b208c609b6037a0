// Chosen outputs over time under the motion, each with a cursor at the time that is shown.

const SIDES = {left: 62, right: 14, top: 18, bottom: 6};
const charts = data.outputs.map(output => {
  const chart = make("svg", {class: "chart", role: "img", "aria-label": output.name}, element("outputs"));
  const lines = models.slice(0, output.curves).map(model => {
    const path = make("path", {class: "curve", style: `--model: ${model.colour}`, "stroke-width": 0.7 * model.width}, chart);
    if (model.dash.length) path.setAttribute("stroke-dasharray", model.dash.join(" "));
    return path;
  });
  const ends = [0, 1].map(() => make("text", {x: SIDES.left - 6, "text-anchor": "end"}, chart, ""));
  make("text", {x: SIDES.left, y: 13}, chart, output.name);
  const value = make("text", {y: 13, "text-anchor": "end"}, chart, "");
  return {chart, lines, ends, value, cursor: make("path", {class: "cursor"}, chart), values: allFrames(output.values)};
});

const across = chart => Math.max(1, chart.clientWidth - SIDES.left - SIDES.right);
const placeOf = (chart, t) => SIDES.left + across(chart) * (end > start ? (t - start) / (end - start) : 0);
const timeUnder = (chart, x) =>
  start + (end - start) * (x - chart.getBoundingClientRect().left - SIDES.left) / across(chart);

const drawOutputs = () => {
  for (const one of charts) {
    const {chart, lines, ends, values} = one;
    const [high, low] = [Math.max, Math.min].map(of => values.reduce((found, row) => of(found, ...row), values[0][0]));
    const height = chart.clientHeight - SIDES.top - SIDES.bottom, size = high - low || 1;
    one.size = size;
    const up = x => SIDES.top + height * (high > low ? (high - x) / size : 0.5);
    lines.forEach((path, k) => path.setAttribute("d", models[k].shown
      ? line(values.map((row, i) => [placeOf(chart, times[i]).toFixed(1), up(row[k]).toFixed(1)])) : ""));
    [high, low].forEach((x, i) => {
      ends[i].setAttribute("y", up(x) + (i ? 0 : 9));
      ends[i].textContent = i && high === low ? "" : short(x, size);
    });
  }
};

const short = (x, size) => {  // to a thousandth of what is drawn
  const digits = Math.max(0, 2 - Math.floor(Math.log10(size)));
  const text = digits > 5 || Math.abs(x) >= 1e5 ? x.toExponential(2) : x.toFixed(digits);
  return Number(text) === 0 ? "0" : text;
};

const moveCursors = frame => {
  const shown = data.smooth ? state.t : times[frame], first = models.findIndex(model => model.shown);
  for (const {chart, cursor, value, values, size} of charts) {
    const x = placeOf(chart, shown), i = Math.floor(frame), k = Math.max(0, first);
    cursor.setAttribute("d", `M${x} ${SIDES.top - 2}V${chart.clientHeight - SIDES.bottom}`);
    const [a, b] = [values[i], values[Math.min(i + 1, values.length - 1)]].map(row => row[k] ?? row[0]);
    value.setAttribute("x", chart.clientWidth - SIDES.right);
    value.textContent = short(a + (frame - i) * (b - a), size);
  }
};
