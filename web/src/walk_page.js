// The page to walk in: drag to look, keys and the slider to move.
import { beside, placeAt, sectorsInView } from "./walk/rail.js";
import { Stage } from "./walk/stage.js";
import { Tiles } from "./walk/tiles.js";

const MARGIN = 0.35; // radians beside the picture that are fetched, too
const CACHE = 512 << 20;
const STEP = 1 / 200; // of the track, a press of a key
const REST = 250; // milliseconds without a move after which the picture is drawn in full
const PROMPT = 40; // milliseconds after a picture in which the next one is asked for in a steady move
const SLOW = 60; // milliseconds between pictures of a move above which they have fewer pixels
const FAST = 25; // below which they have more
const COARSEST = 0.4; // of the pixels of a row, while moving
const asked = new URLSearchParams(location.search);

/** A number of the address, or the usual one where it has none. */
function given(name, usual, least = -Infinity, most = Infinity) {
  const value = Number(asked.get(name) ?? usual);
  return Number.isFinite(value) ? Math.min(Math.max(value, least), most) : usual;
}

const canvas = document.getElementById("picture");
const status = document.getElementById("status");
const slider = document.getElementById("place");
const said = (name) => document.querySelector(`[data-figure=${name}]`);
const number = (value) => value.toLocaleString("en");
const bytes = (value) => (value < 1e6 ? `${(value / 1e3).toFixed(0)} kB` : `${(value / 1e6).toFixed(1)} MB`);

async function start() {
  const response = await fetch("walk.json");
  if (!response.ok) throw new Error(await response.text());
  const walk = await response.json();
  const stage = new Stage(walk, canvas);
  const tiles = new Tiles(walk, given("cache", CACHE, 0), (sector) => stage.drop(sector));
  const now = {
    t: given("t", 0, 0, 1),
    yaw: (given("yaw", 0) * Math.PI) / 180,
    pitch: (given("pitch", 0) * Math.PI) / 180,
    fov: given("fov", 60, 5, 150),
    travel: 1,
    slabs: walk.slabs.map(() => true),
    complete: false,
    first: null,
    quads: 0,
    frames: 0,
    error: null,
  };
  let round = 0;
  let drawing = false;
  // Pixels of a row that are drawn: all, or fewer while moving where that is slow.
  const sharp = { now: 1, moving: 1, moves: false, drawn: 0, done: 0, pace: 0, rest: 0 };

  const list = document.getElementById("slabs");
  walk.slabs.forEach(([near, far], index) => {
    const box = document.createElement("input");
    box.type = "checkbox";
    box.checked = true;
    box.name = `slab${index}`;
    box.addEventListener("change", () => {
      now.slabs[index] = box.checked;
      refresh();
    });
    const line = document.createElement("label");
    const end = far === null ? "and beyond" : `to ${far.toPrecision(3)}`;
    line.append(box, ` slab ${index + 1}: ${near.toPrecision(3)} ${end}`);
    list.append(line);
  });
  // On a phone the figures would cover the picture.
  if (matchMedia("(pointer: coarse) and ((max-width: 520px) or (max-height: 520px))").matches) document.querySelector("details").open = false;
  const culling = walk.culling || {};
  said("alpha").textContent = culling.method ? `${culling.method}, ${culling.alpha}` : "none";

  function halfWidth() {
    const half = Math.tan((now.fov * Math.PI) / 360);
    const corner = Math.hypot(half * stage.camera.aspect, half);
    const tilt = Math.abs(now.pitch) + Math.atan(half);
    return tilt > 1.2 ? Math.PI : Math.atan(corner / Math.cos(tilt)) + 0.05;
  }

  function sides() {
    const { first, second, between, exact } = beside(walk, now.t);
    return { references: first === second || exact ? [first] : [first, second], between, exact };
  }

  /** Fetches what the view needs, nearest the gaze first, then what comes next along the way. */
  async function refresh() {
    const mine = ++round;
    now.complete = false;
    draw();
    const { references } = sides();
    const slabs = now.slabs.flatMap((on, index) => (on ? [index] : []));
    const sectors = sectorsInView(walk, now.yaw, halfWidth());
    try {
      await Promise.all(references.map((reference) => tiles.fetch(reference, slabs, sectors)));
      now.error = null;
      if (mine !== round) return;
      now.complete = true;
      draw();
      const wide = sectorsInView(walk, now.yaw, halfWidth() + MARGIN);
      for (const reference of references) await tiles.fetch(reference, slabs, wide);
      const ahead = now.travel > 0 ? Math.max(...references) + 1 : Math.min(...references) - 1;
      if (mine === round && walk.references[ahead]) await tiles.fetch(ahead, slabs, wide);
    } catch (error) {
      now.error = error.message;
    }
    status.textContent = now.error ? `Something could not be fetched: ${now.error}` : "";
    report();
  }

  function resize() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    stage.resize(canvas.clientWidth, canvas.clientHeight, ratio * sharp.now);
  }

  function sharpen(share) {
    if (sharp.now === share) return;
    sharp.now = share;
    resize();
  }

  /** From how fast the pictures of a move follow each other, where each was asked for soon after the last, follows how
   * many pixels the next one has. */
  function adapt(asked, time) {
    const since = time - sharp.drawn;
    if (asked - sharp.done < PROMPT) {
      sharp.pace = sharp.pace ? (sharp.pace + since) / 2 : since;
      if (sharp.pace > SLOW) sharp.moving = Math.max(COARSEST, sharp.moving * 0.8);
      else if (sharp.pace < FAST) sharp.moving = Math.min(1, sharp.moving / 0.8);
    } else {
      sharp.pace = 0;
    }
    sharpen(sharp.moving);
  }

  /** Draws in full when nothing moves. */
  function rest() {
    clearTimeout(sharp.rest);
    if (sharp.now === 1) return;
    sharp.rest = setTimeout(() => {
      if (drawing) return;
      sharpen(1);
      draw();
    }, REST);
  }

  function drawNow() {
    drawing = false;
    const { references, between, exact } = sides();
    const sectors = sectorsInView(walk, now.yaw, halfWidth());
    const shown = references.map((reference) => ({
      reference,
      sectors: now.slabs.flatMap((on, slab) =>
        on ? sectors.map((sector) => tiles.get(reference, slab, sector)).filter(Boolean) : [],
      ),
    }));
    const eye = placeAt(walk, now.t);
    stage.draw(eye, now, now.fov, shown, between, exact);
    now.frames++;
    now.quads = shown.reduce((sum, side) => sum + side.sectors.reduce((all, sector) => all + sector.quads.length / 7, 0), 0);
    if (now.complete && now.first === null) now.first = performance.now();
    said("exact").textContent = exact ? "exact" : references.length === 1 ? "beyond a reference" : "between two references";
    said("tiles").textContent = number(
      shown.reduce((sum, side) => sum + side.sectors.reduce((all, sector) => all + sector.tiles.length, 0), 0),
    );
    report();
  }

  function draw() {
    if (drawing) return;
    drawing = true;
    const asked = performance.now();
    requestAnimationFrame(() => {
      const time = performance.now();
      if (sharp.moves) adapt(asked, time);
      Object.assign(sharp, { moves: false, drawn: time });
      drawNow();
      sharp.done = performance.now();
      rest();
    });
  }

  async function report() {
    said("received").textContent = bytes(tiles.received);
    said("kept").textContent = bytes(tiles.bytes);
    const { references } = sides();
    const views = await Promise.all(references.map((reference) => tiles.view(reference))).catch(() => []);
    const count = (name) => views.reduce((sum, view) => sum + view.slabs.reduce((all, slab) => all + slab[name], 0), 0);
    said("culled").textContent = `${number(count("culled"))} hidden, ${number(count("empty"))} empty`;
  }

  let ticked = performance.now();
  let counted = 0;
  setInterval(() => {
    const since = performance.now() - ticked;
    said("rate").textContent = now.frames === counted ? "at rest" : ((1000 * (now.frames - counted)) / since).toFixed(0);
    ticked += since;
    counted = now.frames;
  }, 1000);

  function go(t, yaw = now.yaw, pitch = now.pitch) {
    const clamped = Math.min(Math.max(t, 0), 1);
    if (clamped !== now.t || yaw !== now.yaw || pitch !== now.pitch) sharp.moves = true;
    if (clamped !== now.t) now.travel = Math.sign(clamped - now.t);
    Object.assign(now, { t: clamped, yaw, pitch: Math.min(Math.max(pitch, -1.55), 1.55) });
    slider.value = String(clamped);
    slider.setAttribute("aria-valuetext", `${(100 * clamped).toFixed(0)} % of the way`);
    refresh();
  }

  const MOVES = {
    ArrowUp: [1, 0, 0],
    ArrowDown: [-1, 0, 0],
    w: [1, 0, 0],
    s: [-1, 0, 0],
    ArrowLeft: [0, -1, 0],
    ArrowRight: [0, 1, 0],
    a: [0, -1, 0],
    d: [0, 1, 0],
    PageUp: [0, 0, 1],
    PageDown: [0, 0, -1],
  };
  window.addEventListener("keydown", (event) => {
    const move = MOVES[event.key];
    if (!move || event.ctrlKey || event.metaKey || (event.target === slider && event.key.startsWith("Arrow"))) return;
    event.preventDefault();
    go(now.t + STEP * move[0], now.yaw + 0.06 * move[1], now.pitch + 0.06 * move[2]);
  });
  slider.addEventListener("input", () => go(Number(slider.value)));
  const fingers = new Map();
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const perPixel = (now.fov * Math.PI) / 180 / canvas.clientHeight;
    const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    go(now.t, now.yaw - dx * perPixel, now.pitch + dy * perPixel);
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
  }
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      go(now.t - Math.sign(event.deltaY) * STEP);
    },
    { passive: false },
  );
  new ResizeObserver(() => {
    resize();
    refresh();
  }).observe(canvas);

  resize();
  window.cyclorama = {
    walk,
    go,
    draw() {
      sharpen(1);
      drawNow();
    },
    state: () => ({ ...now, sharp: sharp.now, received: tiles.received, kept: tiles.bytes, eye: placeAt(walk, now.t) }),
  };
  go(now.t);
}

start().catch((error) => {
  status.textContent = `This walk cannot be shown: ${error.message}`;
});
