// What the page is told, decoded from numbers as `coding.py` writes them.

const data = JSON.parse(document.getElementById("data").textContent);
const element = id => document.getElementById(id);
const solid = data.dimension === 3;

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

const allFrames = coded => {  // the values of each frame
  const block = decode(coded);
  return Array.from({length: data.frames}, (_, i) => {
    const values = Array(block.base.length).fill(0);
    add(values, block, i, 1);
    return values;
  });
};

const times = allFrames(data.times).map(([t]) => t);
const [start, end] = [times[0], times[times.length - 1]];
const models = data.models.map((model, index) => ({
  ...model, index, shown: !data.alternatives || index === 0, traces: [],
  parts: model.parts.map(part => ({...part, move: decode(part.move), bend: part.bend && decode(part.bend),
    values: part.values && decode(part.values)})),
}));

const valuesOf = (block, frame) => {
  const values = new Float64Array(block.base.length);
  add(values, block, frame, 1);
  return values;
};
const pointsOf = (part, frame, scale = state.scale) => {
  const values = valuesOf(part.move, frame);
  if (part.bend) add(values, part.bend, frame, scale);
  return values;
};
