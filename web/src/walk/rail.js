// The track by share of its length, and the directions of a panorama's pixel corners.

/** The place of a share t of the track, as Track.at has it. */
export function placeAt(walk, t) {
  const { knots, at_knots: at } = walk;
  let k = 0;
  while (k < at.length - 2 && at[k + 1] <= t) k++;
  const along = at[k + 1] > at[k] ? (t - at[k]) / (at[k + 1] - at[k]) : 0;
  return knots[k].map((x, axis) => x * (1 - along) + knots[k + 1][axis] * along);
}

/**
 * The references beside a place, how far between them it is, and whether it is the first one itself, as Store.beside has
 * it: before the first and after the last reference both are the same one.
 */
export function beside(walk, t) {
  const places = walk.references.map((entry) => entry.t);
  let first = 0;
  while (first < places.length - 1 && places[first + 1] <= t) first++;
  const exact = t === places[first];
  if (t < places[0] || first === places.length - 1) return { first, second: first, between: 0, exact };
  return { first, second: first + 1, between: (t - places[first]) / (places[first + 1] - places[first]), exact };
}

/**
 * A function that gives the world's direction of a place in a panorama's pixels, of halves of them: columns go round, rows
 * end with the panorama.
 */
export function directions(walk) {
  const [width, height] = walk.size;
  const [right, up, back] = walk.axes;
  const columns = Array.from({ length: 2 * width }, (_, x) => {
    const turn = 2 * Math.PI * (x / (2 * width) - 0.5);
    return [Math.sin(turn), Math.cos(turn)];
  });
  const rows = Array.from({ length: 2 * height + 1 }, (_, y) => {
    const tilt =
      walk.projection === "cylinder"
        ? Math.atan(((height - y) * Math.PI) / width)
        : Math.PI * (0.5 - y / (2 * height));
    return [Math.cos(tilt), Math.sin(tilt)];
  });
  return (x, y) => {
    const [sin, cos] = columns[(2 * x + 2 * width) % (2 * width)];
    const [flat, high] = rows[Math.min(Math.max(2 * y, 0), 2 * height)];
    return right.map((r, axis) => r * sin * flat + up[axis] * high - back[axis] * cos * flat);
  };
}

/** Sectors of tiles that a camera may see: those whose middle turns from its gaze by less than what it sees and half a sector. */
export function sectorsInView(walk, yaw, halfWidth) {
  const wide = (walk.sector * walk.tile * 2 * Math.PI) / walk.size[0];
  const count = Math.ceil(walk.size[0] / walk.tile / walk.sector);
  const found = [];
  for (let sector = 0; sector < count; sector++) {
    const middle = (sector + 0.5) * wide - Math.PI;
    const off = Math.abs(((((middle - yaw) % (2 * Math.PI)) + 3 * Math.PI) % (2 * Math.PI)) - Math.PI);
    if (off <= halfWidth + wide / 2) found.push({ sector, off });
  }
  return found.sort((a, b) => a.off - b.off).map((entry) => entry.sector);
}
