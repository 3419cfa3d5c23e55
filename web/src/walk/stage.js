// Draws what an eye sees: the slabs of two references as textured quads, then both pictures mixed (2003, section 5).
import * as THREE from "three";
import { directions } from "./rail.js";

const STEPS = 65535;
const ACROSS = 8; // cells in a row of a sector's picture
const LEAST = 0.5; // of a corner's disparity, what is left of it at least when a quad is made larger
const FAR = 1e4; // what is at infinity lies so many track lengths and ranges away

// Seen from beside a reference, pixels are of one surface or of another; from the reference itself, the slabs lie over
// each other and their pixels mix, so that the panorama is what it was before it was cut.
const SHOW = {
  vertexShader: `
    in vec3 place;
    out vec3 at; out float range;
    void main() {
      vec4 eye = modelViewMatrix * vec4(position, 1.0);
      at = place; range = -eye.z;
      gl_Position = projectionMatrix * eye;
    }`,
  fragmentShader: `
    uniform bool exact;
    uniform sampler2D picture;
    in vec3 at; in float range;
    layout(location = 0) out vec4 color;
    layout(location = 1) out vec4 near;
    void main() {
      vec4 found = texture(picture, at.xy / at.z);
      if (!exact && found.a < 0.5) discard;
      color = exact ? found : vec4(found.rgb / found.a, 1.0);
      near = vec4(1.0 / range, 0.0, 0.0, 1.0);
    }`,
};

// As src/panorama/view.rs combines: weights grow as the square of nearness; of what lies behind the other, little stays.
const MIX = {
  vertexShader: "out vec2 at; void main() { at = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }",
  fragmentShader: `
    uniform sampler2D colorA, colorB, nearA, nearB;
    uniform float between; uniform vec3 background;
    in vec2 at; out vec4 color;
    void main() {
      vec4 a = texture(colorA, at), b = texture(colorB, at);
      float da = texture(nearA, at).r, db = texture(nearB, at).r;
      float wa = (1.0 - between) * (1.0 - between), wb = between * between;
      if (a.a == 0.0 && b.a == 0.0) { color = vec4(background, 1.0); return; }
      if (b.a == 0.0 || wb == 0.0) { color = a.a < 0.5 ? vec4(background, 1.0) : vec4(a.rgb / a.a, 1.0); return; }
      if (a.a == 0.0 || wa == 0.0) { color = b; return; }
      if (abs(da - db) > 0.05 * max(da, db)) { if (da > db) wb *= 0.02; else wa *= 0.02; }
      color = vec4((wa * a.rgb + wb * b.rgb) / (wa + wb), 1.0);
    }`,
};

/**
 * The corners of a sector's quads around its reference, as a geometry with a place in its picture for each. As in
 * src/panorama/view.rs, quads of more than a pixel are half a pixel larger on all sides, so that no gaps are left where
 * they meet smaller ones.
 */
export function geometryOf(walk, sector, direction) {
  const count = sector.quads.length / 7;
  const position = new Float32Array(12 * count);
  const places = new Float32Array(12 * count);
  const index = new Uint32Array(6 * count);
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
    index.set([0, 2, 1, 1, 2, 3].map((k) => 4 * quad + k), 6 * quad);
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(position, 3));
  geometry.setAttribute("place", new THREE.BufferAttribute(places, 3));
  geometry.setIndex(new THREE.BufferAttribute(index, 1));
  return geometry;
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
    const gl = this.renderer.getContext();
    this.float = gl.getExtension("EXT_color_buffer_float") ? THREE.FloatType : THREE.HalfFloatType;
    this.camera = new THREE.PerspectiveCamera(60, 1, 1e-3, 1);
    this.shapes = new Map();
    this.targets = [0, 1].map(() => this.target(4, 4));
    this.groups = [new THREE.Scene(), new THREE.Scene()];
    this.mixer = new THREE.ShaderMaterial({
      ...MIX,
      glslVersion: THREE.GLSL3,
      depthTest: false,
      depthWrite: false,
      uniforms: Object.fromEntries(
        ["colorA", "colorB", "nearA", "nearB", "between", "background"].map((name) => [name, { value: null }]),
      ),
    });
    this.mixer.uniforms.background.value = new THREE.Vector3(...walk.background.map((c) => c / 255));
    this.screen = new THREE.Scene();
    this.screen.add(new THREE.Mesh(new THREE.PlaneGeometry(2, 2), this.mixer));
    this.flat = new THREE.Camera();
  }

  target(width, height) {
    const target = new THREE.WebGLRenderTarget(width, height, {
      count: 2,
      minFilter: THREE.NearestFilter,
      magFilter: THREE.NearestFilter,
      depthTexture: new THREE.DepthTexture(width, height, THREE.FloatType),
    });
    target.textures[1].format = THREE.RedFormat;
    target.textures[1].type = this.float;
    return target;
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
      const shows = (exact, how) =>
        new THREE.ShaderMaterial({
          ...SHOW,
          ...how,
          glslVersion: THREE.GLSL3,
          side: THREE.DoubleSide,
          uniforms: { picture: { value: texture }, exact: { value: exact } },
        });
      const over = {
        transparent: true,
        depthTest: false,
        depthWrite: false,
        blending: THREE.CustomBlending,
        blendSrc: THREE.OneFactor,
        blendDst: THREE.OneMinusSrcAlphaFactor,
      };
      const between = new THREE.Mesh(geometryOf(this.walk, sector, this.direction), shows(false, {}));
      const exact = new THREE.Mesh(shellOf(this.walk, sector, this.direction), shows(true, over));
      exact.renderOrder = -sector.slab;
      between.frustumCulled = exact.frustumCulled = false;
      this.shapes.set(name, { between, exact });
    }
    return this.shapes.get(name);
  }

  drop(sector) {
    const name = `${sector.reference}.${sector.slab}.${sector.sector}`;
    const shape = this.shapes.get(name);
    if (!shape) return;
    shape.between.material.uniforms.picture.value.dispose();
    for (const mesh of [shape.between, shape.exact]) {
      mesh.geometry.dispose();
      mesh.material.dispose();
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
    const span = this.walk.track_length + this.walk.slabs[0][0];
    camera.near = exact ? 0.03 : Math.max(this.walk.slabs[0][0] * 0.05, span * 1e-4);
    camera.far = camera.near * 1e7;
    camera.updateProjectionMatrix();
    camera.position.set(0, 0, 0);
    camera.up.copy(up);
    camera.lookAt(forward);
    camera.updateMatrixWorld();
    sides.forEach((side, which) => {
      const group = this.groups[which];
      group.clear();
      const from = this.walk.references[side.reference].eye;
      for (const sector of side.sectors) {
        const mesh = exact ? this.shape(sector).exact : this.shape(sector).between;
        if (!exact) mesh.position.set(...from.map((x, axis) => x - eye[axis]));
        group.add(mesh);
      }
      this.renderer.setRenderTarget(this.targets[which]);
      this.renderer.setClearColor(0x000000, 0);
      this.renderer.clear();
      this.renderer.render(group, camera);
    });
    const last = this.targets[sides.length - 1];
    const u = this.mixer.uniforms;
    [u.colorA.value, u.nearA.value] = this.targets[0].textures;
    [u.colorB.value, u.nearB.value] = last.textures;
    u.between.value = sides.length > 1 ? between : 0;
    this.renderer.setRenderTarget(null);
    this.renderer.clear();
    this.renderer.render(this.screen, this.flat);
  }
}
