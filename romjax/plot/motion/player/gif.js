// Moving pictures of CompuServe's Graphics Interchange Format, version 89a (1990).

const low = (...numbers) => numbers.flatMap(x => [x & 255, x >> 8]);
const ascii = text => [...text].map(sign => sign.charCodeAt(0));

// The 256 colours that are most frequent, to five bits, and the number of the nearest to each.
const paletteOf = pixels => {
  const counts = new Map(), nearest = new Map();
  for (let i = 0; i < pixels.length; i += 4) {
    const key = (pixels[i] >> 3) << 10 | (pixels[i + 1] >> 3) << 5 | pixels[i + 2] >> 3;
    const found = counts.get(key) ?? {count: 0, colour: [...pixels.subarray(i, i + 3)]};
    found.count++;
    counts.set(key, found);
  }
  const colours = [...counts.values()].sort((a, b) => b.count - a.count).slice(0, 256).map(({colour}) => colour);
  const numberOf = (r, g, b) => {
    const key = r << 16 | g << 8 | b;
    if (!nearest.has(key)) {
      const away = colours.map(colour => (colour[0] - r) ** 2 + (colour[1] - g) ** 2 + (colour[2] - b) ** 2);
      nearest.set(key, away.indexOf(Math.min(...away)));
    }
    return nearest.get(key);
  };
  return {colours, numberOf};
};

// Lempel, Ziv and Welch's codes of bytes, from 9 to 12 bits, the lowest bit first.
const compress = bytes => {
  const CLEAR = 256, out = [];
  let known = new Map(), next = CLEAR + 2, width = 9, bits = 0, held = 0, prefix = bytes[0];
  const put = code => {
    bits |= code << held;
    for (held += width; held >= 8; held -= 8) { out.push(bits & 255); bits >>>= 8; }
  };
  put(CLEAR);
  for (let i = 1; i < bytes.length; i++) {
    const key = prefix << 8 | bytes[i], longer = known.get(key);
    if (longer !== undefined) { prefix = longer; continue; }
    put(prefix);
    prefix = bytes[i];
    if (next === 4096) {
      put(CLEAR);
      [known, next, width] = [new Map(), CLEAR + 2, 9];
    } else {
      if (next === 1 << width) width++;
      known.set(key, next++);
    }
  }
  put(prefix);
  put(CLEAR + 1);
  if (held) out.push(bits & 255);
  return out;
};

const newFilm = delay => {  // [1/100 s]; for ever
  const parts = [];
  let palette = null;
  const add = ({width, height, data: pixels}) => {
    if (!palette) {  // the colours of all frames are those of the first
      palette = paletteOf(pixels);
      const table = Array.from({length: 256}, (_, i) => palette.colours[i] ?? [0, 0, 0]).flat();
      parts.push([...ascii("GIF89a"), ...low(width, height), 0xf7, 0, 0, ...table]);
      parts.push([0x21, 0xff, 11, ...ascii("NETSCAPE2.0"), 3, 1, 0, 0, 0]);
    }
    const bytes = new Uint8Array(width * height);
    for (let i = 0; i < bytes.length; i++) bytes[i] = palette.numberOf(pixels[4 * i], pixels[4 * i + 1], pixels[4 * i + 2]);
    parts.push([0x21, 0xf9, 4, 0, ...low(delay), 0, 0, 0x2c, 0, 0, 0, 0, ...low(width, height), 0, 8]);
    const coded = compress(bytes);
    for (let i = 0; i < coded.length; i += 255) parts.push([Math.min(255, coded.length - i), ...coded.slice(i, i + 255)]);
    parts.push([0]);
  };
  return {add, end: () => new Uint8Array([...parts, [0x3b]].flat())};
};
