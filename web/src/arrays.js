// Arrays as Python packs them (pages/packing.py): a line of JSON that names them, then their bytes, 8-byte aligned.

const TYPES = { uint8: Uint8Array, uint32: Uint32Array, float32: Float32Array };

/** {head, arrays} of an ArrayBuffer. */
export function unpack(buffer) {
  const bytes = new Uint8Array(buffer);
  const end = bytes.indexOf(10);
  const head = JSON.parse(new TextDecoder().decode(bytes.subarray(0, end)));
  const arrays = {};
  for (const { name, dtype, start, length } of head.arrays) {
    arrays[name] = new TYPES[dtype](buffer, start, length);
  }
  return { ...head.values, ...arrays };
}

/** The arrays of gzipped bytes in base64. */
export async function unpackText(text) {
  const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return unpack(await new Response(stream).arrayBuffer());
}
