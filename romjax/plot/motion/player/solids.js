// Bodies in space: faces of boxes and meshes, and tubes along lines; the farthest first.

const LIGHT = [-0.37, 0.56, 0.74];  // towards it, in the directions of the picture and of the eye
const TUBE = ["edge", "side", "lit"];  // strokes over each other

let collected = [];
const addSolid = (outline, list, values, colours) => {  // its points in the picture and in space, its colours
  const toward = axes()[2], d = data.dimension;
  const depth = dot(toward, Array.from({length: d}, (_, i) => {
    let sum = 0;
    for (let j = i; j < values.length; j += d) sum += values[j];
    return sum / outline.points;
  }));
  collected.push({outline, list, values, depth, colours});
};

// How much light a face has, from 0 to 1; nothing of one that is turned away.
const lightOn = (face, values, ways) => {
  const [a, b, c] = face.map(k => values.subarray(3 * k, 3 * k + 3));
  const [u, v] = [b, c].map(p => [0, 1, 2].map(i => p[i] - a[i]));
  const normal = [0, 1, 2].map(i => u[(i + 1) % 3] * v[(i + 2) % 3] - u[(i + 2) % 3] * v[(i + 1) % 3]);
  const length = Math.hypot(...normal) || 1, seen = ways.map(way => dot(way, normal) / length);
  return seen[2] > 0 ? Math.max(0, dot(LIGHT, seen)) : null;
};

const drawSolids = model => {
  const ways = axes(), strokes = [];
  collected.sort((one, other) => one.depth - other.depth);
  for (const {outline, list, values, colours} of collected) {
    if (!outline.faces) {
      TUBE.forEach(name => strokes.push([line(list) + (outline.closed ? "Z" : ""), `tube ${name}`, ""]));
      if (colours) inColours(list, colours).forEach(([d, colour]) => strokes.push([d, "coloured", colour]));
    } else for (const face of outline.faces) {
      const light = lightOn(face, values, ways);
      if (light !== null) strokes.push([`${line(face.map(k => list[k]))}Z`, "face", `--light: ${Math.round(100 * light)}%`]);
    }
  }
  collected = [];
  paint(solids, strokes, model);
};
