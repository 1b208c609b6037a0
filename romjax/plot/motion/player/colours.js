// Stress resultants as colours: red of what is positive, blue of what is negative.

const LEVELS = 24;  // of each sign
const levelOf = value => Math.round(LEVELS * Math.max(-1, Math.min(1, value / data.colours.largest)));
const paintOf = level => `--way: var(--${level < 0 ? "push" : "pull"}); --share: ${Math.round(100 * Math.abs(level) / LEVELS)}%`;

// A line in pieces: [path, colour] for each level.
const inColours = (list, values) => {
  const pieces = new Map();
  for (let i = 0; i + 1 < list.length; i++) {
    const level = levelOf((values[i] + values[i + 1]) / 2);
    pieces.set(level, `${pieces.get(level) ?? ""}M${list[i].join(" ")}L${list[i + 1].join(" ")}`);
  }
  return [...pieces].map(([level, d]) => [d, paintOf(level)]);
};

// As many paths as there are strokes [path, class, colour], in their order.
const paint = (group, strokes, model) => {
  while (group.children.length < strokes.length) make("path", {}, group);
  while (group.children.length > strokes.length) group.lastChild.remove();
  strokes.forEach(([d, name, colour], i) => {
    const style = `--model: ${model.colour}; ${colour}`;
    Object.entries({d, class: name, style}).forEach(([key, value]) => group.children[i].setAttribute(key, value));
  });
};

const drawColours = () => {  // what they stand for
  if (!data.colours) return;
  const {name, least, largest} = data.colours, wide = 140, x = view.width - MARGIN.right - wide - 40, y = 24;
  const first = Math.round(LEVELS * least / largest), each = wide / (LEVELS - first);
  for (let level = first; level < LEVELS; level++)
    make("path", {class: "coloured", style: `stroke-width: 8px; ${paintOf(level + 0.5)}`,
      d: `M${x + each * (level - first)} ${y}h${each + 0.5}`}, grid);
  make("text", {x: x + wide / 2, y: 14, "text-anchor": "middle"}, grid, name);
  const [low, high] = [least, largest].map(value => Number(value.toPrecision(3)).toString().replace("-", "\u2212"));
  make("text", {x: x - 5, y: y + 4, "text-anchor": "end"}, grid, low);
  make("text", {x: x + wide + 5, y: y + 4}, grid, high);
};
