// Sectors of tiles from the server: many in one request, kept up to a limit of bytes, those first that were used last.
import { unpack } from "../arrays.js";

/** Quads by 7s, of a file as cyclorama.panorama.tiles describes it. */
async function unpackQuads(packed) {
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const half = bytes.length / 2;
  const count = half / 7;
  const quads = new Uint16Array(half); // arithmetic on its entries is modulo 65536
  for (let quad = 0; quad < count; quad++) {
    const [x, y, side, a, b, c, d] = Array.from({ length: 7 }, (_, column) => {
      const at = column * count + quad;
      const folded = bytes[at] | (bytes[half + at] << 8);
      return (folded >> 1) ^ -(folded & 1);
    });
    const at = 7 * quad;
    quads.set([x, y, side, a], at);
    if (quad > 0) for (const column of [0, 1, 3]) quads[at + column] += quads[at + column - 7];
    quads[at + 4] = quads[at + 3] + b;
    quads[at + 5] = quads[at + 3] + c;
    quads[at + 6] = d + quads[at + 4] + quads[at + 5] - quads[at + 3];
  }
  return quads;
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
      const type = `image/${this.walk.codec}`;
      for (const { name, slab, entry } of wanted) {
        const picture = new Blob([files[`${folder}/${entry.image}`]], { type });
        const image = await createImageBitmap(picture, { premultiplyAlpha: "none", colorSpaceConversion: "none" });
        const quads = await unpackQuads(files[`${folder}/${entry.quads}`]);
        const { disparity } = view.slabs[slab];
        const bytes = 4 * image.width * image.height + 8 * quads.length;
        this.kept.set(name, { reference, slab, sector: entry.sector, tiles: entry.tiles, image, quads, disparity, bytes });
      }
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
