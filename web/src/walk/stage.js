// Draws what an eye sees: the slabs of two references as textured quads, then both pictures mixed (2003, section 5).
import * as THREE from "three";
import { directions } from "./rail.js";

const STEPS = 65535;
const ACROSS = 8; // cells in a row of a sector's picture
const LEAST = 0.5; // of a corner's disparity, what is left of it at least when a quad is made larger
const LEAST_KEPT = "6.2e-5"; // the least share of the nearest disparity that 16 bits hold with all their precision
const FAR = 1e4; // what is at infinity lies so many track lengths and ranges away

// What is compared for nearness is disparity along the axis, less the back of the slab: see src/panorama/view.rs. The
// buffer holds it from -most, which none is below, to the nearest surface's.
const PLACE = `
    in vec3 place;
    uniform float back, most, nearest;
    out vec3 at; out float range;
    void main() {
      vec4 eye = modelViewMatrix * vec4(position, 1.0);
      at = place; range = -eye.z;
      gl_Position = projectionMatrix * eye;
      gl_Position.z = range - 2.0 * (1.0 - back * length(eye.xyz) + most * range) / (nearest + most);
    }`;

// Seen from beside a reference, pixels are of one surface or of another; quads without a transparent pixel need not ask
// which, and what they hide is not looked up.
const SOLID = {
  vertexShader: PLACE,
  fragmentShader: `
    uniform sampler2D picture; uniform float nearest;
    in vec3 at; in float range;
    out vec4 color;
    void main() { color = vec4(textureLod(picture, at.xy / at.z, 0.0).rgb, max(1.0 / (nearest * range), ${LEAST_KEPT})); }`,
};
const CUT = {
  vertexShader: PLACE,
  fragmentShader: `
    uniform sampler2D picture; uniform float nearest;
    in vec3 at; in float range;
    out vec4 color;
    void main() {
      vec4 found = textureLod(picture, at.xy / at.z, 0.0);
      if (found.a < 0.5) discard;
      color = vec4(found.rgb / found.a, max(1.0 / (nearest * range), ${LEAST_KEPT}));
    }`,
};

// From the reference itself, the slabs lie over each other and their pixels mix, so that the panorama is what it was
// before it was cut.
const EXACT = {
  vertexShader: `
    in vec3 place;
    out vec2 at;
    void main() { at = place.xy; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }`,
  fragmentShader: `
    uniform sampler2D picture;
    in vec2 at;
    out vec4 color;
    void main() { color = textureLod(picture, at, 0.0); }`,
};

const SCREEN = "void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }";
const SHOW = {
  vertexShader: SCREEN,
  fragmentShader: `
    uniform sampler2D colorA; uniform vec3 background;
    out vec4 color;
    void main() {
      vec4 a = texelFetch(colorA, ivec2(gl_FragCoord.xy), 0);
      color = vec4(a.a < 0.5 ? background : a.rgb / a.a, 1.0);
    }`,
};
// As src/panorama/view.rs combines: weights grow as the square of nearness; of what lies behind the other, little stays.
const MIX = {
  vertexShader: SCREEN,
  fragmentShader: `
    uniform sampler2D colorA, colorB;
    uniform float between; uniform vec3 background;
    out vec4 color;
    void main() {
      vec4 a = texelFetch(colorA, ivec2(gl_FragCoord.xy), 0), b = texelFetch(colorB, ivec2(gl_FragCoord.xy), 0);
      float wa = (1.0 - between) * (1.0 - between), wb = between * between;
      if (a.a == 0.0 && b.a == 0.0) { color = vec4(background, 1.0); return; }
      if (b.a == 0.0 || wb == 0.0) { color = vec4(a.a == 0.0 ? background : a.rgb, 1.0); return; }
      if (a.a == 0.0 || wa == 0.0) { color = vec4(b.rgb, 1.0); return; }
      if (abs(a.a - b.a) > 0.05 * max(a.a, b.a)) { if (a.a > b.a) wb *= 0.02; else wa *= 0.02; }
      color = vec4((wa * a.rgb + wb * b.rgb) / (wa + wb), 1.0);
    }`,
};

/**
 * The corners of a sector's quads around its reference, as a geometry with a place in its picture for each. As in
 * src/panorama/view.rs, quads of more than a pixel are half a pixel larger on all sides, so that no gaps are left where
 * they meet smaller ones. First come the quads without a transparent pixel in or beside them: so many indices are `solid`.
 */
export function geometryOf(walk, sector, direction) {
  const count = sector.quads.length / 7;
  const position = new Float32Array(12 * count);
  const places = new Float32Array(12 * count);
  const index = [[], []];
  const [width] = walk.size;
  const { tile } = walk;
  const across = width / tile;
  const cell = tile + 2;
  const cells = new Map(sector.tiles.map((number, at) => [number, at]));
  const size = [sector.image.width, sector.image.height];
  const [low, high] = sector.disparity;
  const farthest = FAR * (walk.track_length + 1 / Math.max(high, 1e-30));
  for (let quad = 0; quad < count; quad++) {
    const [x, y, side, ...steps] = sector.quads.subarray(7 * quad, 7 * quad + 7);
    const column = Math.floor(x / tile);
    const row = Math.floor(y / tile);
    const place = cells.get(row * across + column);
    const left = (place % ACROSS) * cell + 1 - column * tile;
    const top = Math.floor(place / ACROSS) * cell + 1 - row * tile;
    let first = 1;
    const margin = side === 1 ? 0 : 0.5;
    const own = Array.from(steps, (step) => low + ((high - low) * step) / STEPS);
    for (let corner = 0; corner < 4; corner++) {
      const px = corner % 2 ? x + side + margin : x - margin;
      const py = corner >> 1 ? y + side + margin : y - margin;
      const beyond = (margin / side) * (2 * own[corner] - own[corner ^ 1] - own[corner ^ 2]);
      const disparity = Math.max(own[corner] + beyond, LEAST * own[corner]);
      const range = Math.min(1 / Math.max(disparity, 1e-30), farthest);
      const [dx, dy, dz] = direction(px, py);
      position.set([dx * range, dy * range, dz * range], 12 * quad + 3 * corner);
      const [u, v] = side === 1 ? [x + 0.5, y + 0.5] : [px, py];
      // Farther corners weigh more: what is halfway between two in space is nearer the farther one in the picture.
      if (corner === 0) first = range;
      const weight = range / first;
      places.set([(weight * (left + u)) / size[0], (weight * (top + v)) / size[1], weight], 12 * quad + 3 * corner);
    }
    const cut = transparent(sector, left + x, top + y, side) ? 1 : 0;
    for (const k of [0, 2, 1, 1, 2, 3]) index[cut].push(4 * quad + k);
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(position, 3));
  geometry.setAttribute("place", new THREE.BufferAttribute(places, 3));
  geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(index.flat()), 1));
  return { geometry, solid: index[0].length, cut: index[1].length };
}

/** Whether a pixel in or beside a block of a sector's picture is transparent. */
function transparent(sector, left, top, side) {
  const { width } = sector.image;
  for (let y = top - 1; y <= top + side; y++) {
    for (let x = left - 1; x <= left + side; x++) if (!sector.opacity[y * width + x]) return true;
  }
  return false;
}

/** A sector's tiles on a sphere around its reference, whole: what the reference itself sees of them. */
function shellOf(walk, sector, direction) {
  const [width] = walk.size;
  const { tile } = walk;
  const across = width / tile;
  const cell = tile + 2;
  const size = [sector.image.width, sector.image.height];
  const step = Math.max(1, Math.min(tile, Math.floor(width / 128))); // pixels; chords of 3 degrees
  const position = [];
  const places = [];
  const index = [];
  sector.tiles.forEach((number, at) => {
    const [x, y] = [(number % across) * tile, Math.floor(number / across) * tile];
    const [left, top] = [(at % ACROSS) * cell + 1, Math.floor(at / ACROSS) * cell + 1];
    const first = position.length / 3;
    const side = tile / step + 1;
    for (let row = 0; row < side; row++) {
      for (let column = 0; column < side; column++) {
        position.push(...direction(x + column * step, y + row * step));
        places.push((left + column * step) / size[0], (top + row * step) / size[1], 1);
        if (row === 0 || column === 0) continue;
        const corner = first + row * side + column;
        index.push(corner - side - 1, corner - 1, corner - side, corner - side, corner - 1, corner);
      }
    }
  });
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(position), 3));
  geometry.setAttribute("place", new THREE.BufferAttribute(new Float32Array(places), 3));
  geometry.setIndex(index);
  return geometry;
}

export class Stage {
  constructor(walk, canvas) {
    this.walk = walk;
    this.direction = directions(walk);
    this.renderer = new THREE.WebGLRenderer({ canvas, preserveDrawingBuffer: true });
    this.renderer.outputColorSpace = THREE.LinearSRGBColorSpace; // colours pass through unchanged
    this.renderer.autoClear = false;
    // Software draws to whole floats faster than to halves; where they can't be drawn to, halves will do.
    const whole = this.renderer.getContext().getExtension("EXT_color_buffer_float");
    const float = whole ? THREE.FloatType : THREE.HalfFloatType;
    this.camera = new THREE.PerspectiveCamera(60, 1, 1e-3, 1);
    this.shapes = new Map();
    // Colours and disparities beside references, colours and opacities at them.
    this.targets = [float, float, THREE.UnsignedByteType].map(
      (type, index) =>
        new THREE.WebGLRenderTarget(4, 4, {
          type,
          minFilter: THREE.NearestFilter,
          magFilter: THREE.NearestFilter,
          depthBuffer: index < 2,
        }),
    );
    this.groups = [new THREE.Scene(), new THREE.Scene()];
    const background = { value: new THREE.Vector3(...walk.background.map((c) => c / 255)) };
    const onScreen = (how, uniforms) =>
      new THREE.ShaderMaterial({ ...how, glslVersion: THREE.GLSL3, depthTest: false, depthWrite: false, uniforms });
    const [colorA, colorB, between] = [{ value: null }, { value: null }, { value: 0 }];
    this.mixer = onScreen(MIX, { colorA, colorB, between, background });
    this.shower = onScreen(SHOW, { colorA: { value: this.targets[2].texture }, background });
    this.depths = { most: { value: 0 }, nearest: { value: 1 } };
    this.screen = new THREE.Scene();
    this.screen.add(new THREE.Mesh(new THREE.PlaneGeometry(2, 2), this.mixer));
    this.flat = new THREE.Camera();
  }

  resize(width, height, ratio) {
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    const size = this.renderer.getDrawingBufferSize(new THREE.Vector2());
    for (const target of this.targets) target.setSize(size.x, size.y);
    this.camera.aspect = width / height;
  }

  shape(sector) {
    const name = `${sector.reference}.${sector.slab}.${sector.sector}`;
    if (!this.shapes.has(name)) {
      const texture = new THREE.Texture(sector.image);
      texture.flipY = false;
      texture.generateMipmaps = false;
      texture.minFilter = texture.magFilter = THREE.LinearFilter;
      texture.needsUpdate = true;
      const shows = (how, uniforms) =>
        new THREE.ShaderMaterial({ ...how, glslVersion: THREE.GLSL3, side: THREE.DoubleSide, uniforms });
      const picture = { value: texture };
      const over = {
        transparent: true,
        depthTest: false,
        depthWrite: false,
        blending: THREE.CustomBlending,
        blendSrc: THREE.OneFactor,
        blendDst: THREE.OneMinusSrcAlphaFactor,
      };
      const seen = { picture, back: { value: sector.back }, ...this.depths };
      const { geometry, solid, cut } = geometryOf(this.walk, sector, this.direction);
      geometry.addGroup(0, solid, 0);
      geometry.addGroup(solid, cut, 1);
      const [whole, holed] = [SOLID, CUT].map((how) => shows({ ...how, blending: THREE.NoBlending }, seen));
      const between = new THREE.Mesh(geometry, [whole, holed]);
      between.renderOrder = sector.slab;
      const exact = new THREE.Mesh(shellOf(this.walk, sector, this.direction), shows({ ...EXACT, ...over }, { picture }));
      exact.renderOrder = -sector.slab;
      between.frustumCulled = exact.frustumCulled = false;
      this.shapes.set(name, { between, exact, texture });
    }
    return this.shapes.get(name);
  }

  drop(sector) {
    const name = `${sector.reference}.${sector.slab}.${sector.sector}`;
    const shape = this.shapes.get(name);
    if (!shape) return;
    shape.texture.dispose();
    for (const mesh of [shape.between, shape.exact]) {
      mesh.geometry.dispose();
      for (const material of [mesh.material].flat()) material.dispose();
    }
    this.shapes.delete(name);
  }

  /**
   * @param eye the eye's place; @param gaze {yaw, pitch} in radians about the panorama's axes; @param fov degrees
   * @param sides [{reference, sectors}] of the one or two references; @param between 0 to 1
   * @param exact whether the eye is at the one reference
   */
  draw(eye, gaze, fov, sides, between, exact) {
    const [right, up, back] = this.walk.axes.map((axis) => new THREE.Vector3(...axis));
    const { camera } = this;
    const flat = Math.cos(gaze.pitch);
    const forward = new THREE.Vector3()
      .addScaledVector(right, Math.sin(gaze.yaw) * flat)
      .addScaledVector(up, Math.sin(gaze.pitch))
      .addScaledVector(back, -Math.cos(gaze.yaw) * flat);
    camera.fov = fov;
    [camera.near, camera.far] = [0.03, 10]; // of what lies on a sphere of 1 around a reference
    camera.updateProjectionMatrix();
    camera.position.set(0, 0, 0);
    camera.up.copy(up);
    camera.lookAt(forward);
    camera.updateMatrixWorld();
    const half = Math.tan((fov * Math.PI) / 360);
    const corner = Math.hypot(1, half, half * camera.aspect);
    const all = sides.flatMap((side) => side.sectors);
    this.depths.most.value = corner * Math.max(0, ...all.map((sector) => sector.back));
    const away = sides.map((side) => Math.hypot(...this.walk.references[side.reference].eye.map((x, k) => x - eye[k])));
    const range = Math.min(...all.map((sector) => 1 / sector.disparity[1])) - Math.max(...away);
    // What is nearer along the axis than any surface may come.
    const span = this.walk.track_length + this.walk.slabs[0][0];
    this.depths.nearest.value = 1 / Math.max((0.5 * range) / corner, 1e-4 * span);
    sides.forEach((side, which) => {
      const group = this.groups[which];
      group.clear();
      const from = this.walk.references[side.reference].eye;
      for (const sector of side.sectors) {
        const mesh = exact ? this.shape(sector).exact : this.shape(sector).between;
        if (!exact) mesh.position.set(...from.map((x, axis) => x - eye[axis]));
        group.add(mesh);
      }
      this.renderer.setRenderTarget(this.targets[exact ? 2 : which]);
      this.renderer.setClearColor(0x000000, 0);
      this.renderer.clear();
      this.renderer.render(group, camera);
    });
    const u = this.mixer.uniforms;
    u.colorA.value = this.targets[0].texture;
    u.colorB.value = this.targets[sides.length - 1].texture;
    u.between.value = sides.length > 1 ? between : 0;
    this.screen.children[0].material = exact ? this.shower : this.mixer;
    this.renderer.setRenderTarget(null);
    this.renderer.render(this.screen, this.flat);
  }
}
