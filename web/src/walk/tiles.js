// Sectors of tiles from the server: many in one request, kept up to a limit of bytes, those first that were used last.
import { unpack } from "../arrays.js";

const ACROSS = 8; // cells in a row of a sector's picture
const NEAR = 32; // steps that a corner of the same surface is off at most

/**
 * Quads by 7s, of a file as cyclorama.panorama.tiles describes it.
 *
 * @param bytes the file, decompressed; @param opacity of the sector's picture: a byte each pixel, row by row
 */
export function unpackQuads(bytes, opacity, tiles, walk) {
  const { tile } = walk;
  const [width, height] = walk.size;
  const across = width / tile;
  const cell = tile + 2;
  const stride = ACROSS * cell;
  const count = new DataView(bytes.buffer, bytes.byteOffset).getUint32(0, true);
  if (8 * count > bytes.length - 4) throw new Error("a file of quads is cut off");
  const high = 4 + 4 * count;
  const flags = 4 + 8 * count;
  const left = Math.min(...tiles.map((number) => number % across)) * tile;
  const columns = (Math.max(...tiles.map((number) => number % across)) + 1) * tile - left + 1;
  const known = new Int32Array(columns * (height + 1)).fill(-1);
  const quads = new Uint16Array(7 * count);
  let [found, asked, last] = [0, 0, 0];

  function leaf(x, y, side) {
    if (found === count) throw new Error("a file of quads is not that of its picture");
    const first = y * columns + x - left;
    const places = [first, first + side, first + side * columns, first + side * columns + side];
    const corners = [0, 0, 0, 0];
    for (let index = 0; index < 4; index++) {
      let guess;
      if (index === 0) {
        const place = places.find((candidate) => known[candidate] >= 0);
        guess = place === undefined ? last : known[place];
      } else {
        const expected = index < 3 ? corners[0] : (corners[1] + corners[2] - corners[0]) & 65535;
        const there = known[places[index]];
        const off = (there - expected) & 65535;
        guess = there >= 0 && Math.min(off, 65536 - off) <= NEAR ? there : expected;
      }
      const at = index * count + found;
      const folded = bytes[4 + at] | (bytes[high + at] << 8);
      corners[index] = (guess + ((folded >> 1) ^ -(folded & 1))) & 65535;
    }
    places.forEach((place, index) => (known[place] = corners[index]));
    last = corners[0];
    quads.set([x, y, side, ...corners], 7 * found++);
  }

  function block(x, y, side, from) {
    let opaque = false;
    for (let row = 0; row < side && !opaque; row++) {
      const start = from + row * stride;
      for (let column = 0; column < side; column++) if (opacity[start + column]) opaque = true;
    }
    if (!opaque) return;
    if (side > 1) {
      const whole = (bytes[flags + (asked >> 3)] >> (asked & 7)) & 1;
      asked++;
      if (!whole) {
        const half = side / 2;
        for (const [right, down] of [[0, 0], [half, 0], [0, half], [half, half]]) {
          block(x + right, y + down, half, from + down * stride + right);
        }
        return;
      }
    }
    leaf(x, y, side);
  }

  tiles.forEach((number, at) => {
    const cornerOfCell = Math.floor(at / ACROSS) * cell * stride + (at % ACROSS) * cell;
    block((number % across) * tile, Math.floor(number / across) * tile, tile, cornerOfCell + stride + 1);
  });
  if (found !== count) throw new Error("a file of quads is not that of its picture");
  return quads;
}

async function inflated(packed) {
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

let reader = null;

/** The opacity of a picture's pixels: a byte each. */
function opacityOf(image) {
  if (!reader || reader.canvas.width < image.width || reader.canvas.height < image.height) {
    const canvas = new OffscreenCanvas(image.width, Math.max(image.height, reader ? reader.canvas.height : 0));
    reader = canvas.getContext("2d", { willReadFrequently: true });
    reader.globalCompositeOperation = "copy";
  }
  reader.drawImage(image, 0, 0);
  const { data } = reader.getImageData(0, 0, image.width, image.height);
  const opacity = new Uint8Array(data.length / 4);
  for (let pixel = 0; pixel < opacity.length; pixel++) opacity[pixel] = data[4 * pixel + 3];
  return opacity;
}

/** How much farther, in disparity, a slab counts than it is: both its error and that of each nearer one's. */
function backOf(slabs, slab) {
  let back = 0;
  for (let k = 0; k < slab; k++) back += slabs[k].error + slabs[k + 1].error;
  return back;
}

async function need(response) {
  if (!response.ok) throw new Error(`${response.status}: ${(await response.text()).slice(0, 200)}`);
  return response;
}

export class Tiles {
  /**
   * @param walk what /walk.json says
   * @param limit bytes of decoded sectors to keep
   * @param drop called with a sector that is no longer kept
   */
  constructor(walk, limit, drop) {
    Object.assign(this, { walk, limit, drop, received: 0, kept: new Map(), asked: new Map(), views: new Map() });
  }

  get bytes() {
    let sum = 0;
    for (const sector of this.kept.values()) sum += sector.bytes;
    return sum;
  }

  /** What view.json says of a reference. */
  view(reference) {
    if (!this.views.has(reference)) {
      const told = fetch(`${this.walk.references[reference].folder}/view.json`)
        .then(need)
        .then(async (response) => {
          const text = await response.text();
          this.received += text.length;
          return JSON.parse(text);
        });
      told.catch(() => this.views.delete(reference));
      this.views.set(reference, told);
    }
    return this.views.get(reference);
  }

  /** A sector that is here, or undefined; asking for it makes it stay. */
  get(reference, slab, sector) {
    const name = `${reference}.${slab}.${sector}`;
    const found = this.kept.get(name);
    if (found) {
      this.kept.delete(name);
      this.kept.set(name, found);
    }
    return found;
  }

  /** Fetches what of these sectors is neither here nor on its way; answers when all of them are. */
  async fetch(reference, slabs, sectors) {
    const view = await this.view(reference);
    const wanted = [];
    const coming = [];
    for (const slab of slabs) {
      for (const entry of view.slabs[slab].sectors) {
        if (!sectors.includes(entry.sector)) continue;
        const name = `${reference}.${slab}.${entry.sector}`;
        if (this.kept.has(name)) continue;
        if (this.asked.has(name)) coming.push(this.asked.get(name));
        else wanted.push({ name, slab, entry });
      }
    }
    if (wanted.length) {
      const request = this.request(reference, view, wanted);
      for (const { name } of wanted) this.asked.set(name, request);
      coming.push(request);
    }
    await Promise.all(coming);
  }

  async request(reference, view, wanted) {
    try {
      const { folder } = this.walk.references[reference];
      const names = wanted.flatMap(({ entry }) => [entry.image, entry.quads]).join(",");
      const response = await need(await fetch(`batch/${folder}?names=${names}`));
      const buffer = await response.arrayBuffer();
      this.received += buffer.byteLength;
      const files = unpack(buffer);
      const shown = wanted.map(async ({ name, slab, entry }) => {
        const type = `image/${entry.image.split(".").pop()}`;
        const picture = new Blob([files[`${folder}/${entry.image}`]], { type });
        const image = await createImageBitmap(picture, { premultiplyAlpha: "none", colorSpaceConversion: "none" });
        const opacity = opacityOf(image);
        const quads = unpackQuads(await inflated(files[`${folder}/${entry.quads}`]), opacity, entry.tiles, this.walk);
        const { disparity } = view.slabs[slab];
        const bytes = 4 * image.width * image.height + 8 * quads.length;
        const { sector, tiles } = entry;
        const back = backOf(view.slabs, slab);
        this.kept.set(name, { reference, slab, sector, tiles, image, opacity, quads, disparity, back, bytes });
      });
      await Promise.all(shown);
      this.trim();
    } finally {
      for (const { name } of wanted) this.asked.delete(name);
    }
  }

  trim() {
    let sum = this.bytes;
    for (const [name, sector] of this.kept) {
      if (sum <= this.limit || this.kept.size <= 1) break;
      this.kept.delete(name);
      this.drop(sector);
      sector.image.close();
      sum -= sector.bytes;
    }
  }
}
