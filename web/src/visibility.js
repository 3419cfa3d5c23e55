// A model as one sample sees it: turned around while the eye stays, with the sphere of samples about it.
import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

const CELL = new THREE.Color("#f5a623");
const MISSED = new THREE.Color("#e0245e");
const PLAIN = new THREE.Color("#b9c0c9");
const ID_WIDTH = 510;
const ID_HEIGHT = 480;

const STYLE = `
.cyc-view { position: relative; width: 100%; height: 100%; min-height: 320px; background: #14171c; color: #e8eaed;
  font: 14px/1.45 system-ui, sans-serif; }
.cyc-view canvas { display: block; outline-offset: -3px; touch-action: none; }
.cyc-panel { position: absolute; top: 10px; left: 10px; padding: 8px 14px; max-width: 17em; border-radius: 8px;
  background: rgba(20, 23, 28, 0.82); box-sizing: border-box; max-height: calc(100% - 20px); overflow: auto; }
.cyc-panel summary { cursor: pointer; }
.cyc-panel h1 { display: inline; font-size: 15px; overflow-wrap: anywhere; }
.cyc-panel dl { display: grid; grid-template-columns: auto 1fr; gap: 0 10px; margin: 6px 0 8px; }
.cyc-panel dt { opacity: 0.7; }
.cyc-panel dd { margin: 0; text-align: right; font-variant-numeric: tabular-nums; }
.cyc-panel label { display: flex; align-items: baseline; gap: 4px; padding: 2px 0; cursor: pointer; }
.cyc-panel label[hidden] { display: none; }
.cyc-panel p { margin: 6px 0 0; opacity: 0.7; font-size: 12px; }
.cyc-panel button { font: inherit; margin-top: 4px; }
@media (max-width: 520px) { .cyc-panel { font-size: 12px; max-width: 13em; padding: 6px 8px; } }
`;

/** Which faces of the sphere a direction passes through: the one on whose inner side it is of all three edges. */
export function locate(points, faces, direction) {
  const [x, y, z] = direction;
  let best = 0;
  let most = -Infinity;
  for (let face = 0; face < faces.length / 3; face++) {
    let least = Infinity;
    for (let k = 0; k < 3; k++) {
      const a = 3 * faces[3 * face + k];
      const b = 3 * faces[3 * face + ((k + 1) % 3)];
      const nx = points[a + 1] * points[b + 2] - points[a + 2] * points[b + 1];
      const ny = points[a + 2] * points[b] - points[a] * points[b + 2];
      const nz = points[a] * points[b + 1] - points[a + 1] * points[b];
      least = Math.min(least, nx * x + ny * y + nz * z);
    }
    if (least > most) {
      most = least;
      best = face;
    }
  }
  return best;
}

/** Faces that a cell answers, ascending. */
export function answered(data, cell) {
  const row = data.rows.subarray(cell * data.rowBytes, (cell + 1) * data.rowBytes);
  const found = [];
  for (let face = 0; face < data.faceCount; face++) {
    const bit = data.labels ? data.labels[face] : face;
    if ((row[bit >> 3] >> (bit & 7)) & 1) found.push(face);
  }
  return found;
}

function faceColors(data) {
  const colors = new Float32Array(9 * data.faceCount);
  for (let face = 0; face < data.faceCount; face++) {
    const c = data.colors
      ? new THREE.Color().setRGB(...[0, 1, 2].map((k) => data.colors[3 * face + k] / 255), THREE.SRGBColorSpace)
      : PLAIN;
    for (let k = 0; k < 3; k++) c.toArray(colors, 9 * face + 3 * k);
  }
  return colors;
}

function patchColors(data) {
  const colors = new Float32Array(9 * data.faceCount);
  for (let face = 0; face < data.faceCount; face++) {
    const c = new THREE.Color().setHSL((data.labels[face] * 0.61803398875) % 1, 0.55, 0.6);
    for (let k = 0; k < 3; k++) c.toArray(colors, 9 * face + 3 * k);
  }
  return colors;
}

function idBytes(count) {
  const ids = new Uint8Array(12 * count);
  for (let face = 0; face < count; face++) {
    for (let k = 0; k < 3; k++) {
      ids.set([(face + 1) & 255, ((face + 1) >> 8) & 255, ((face + 1) >> 16) & 255, 255], 12 * face + 4 * k);
    }
  }
  return ids;
}

function corners(faces) {
  const index = new Uint32Array(3 * faces.length);
  for (let at = 0; at < index.length; at++) index[at] = 3 * faces[(at / 3) | 0] + (at % 3);
  return new THREE.BufferAttribute(index, 1);
}

/** Shows the data in an element; answers {state, dispose}. `state()` tells what the panel says. */
export function mount(element, data) {
  const root = document.createElement("div");
  root.className = "cyc-view";
  const style = document.createElement("style");
  style.textContent = STYLE;
  root.append(style);
  element.append(root);

  const renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
  renderer.domElement.tabIndex = 0;
  renderer.domElement.setAttribute("role", "img");
  renderer.domElement.setAttribute("aria-label", `${data.title}: drag, or use the arrow keys, to turn it`);
  root.append(renderer.domElement);

  const scene = new THREE.Scene();
  scene.background = new THREE.Color("#14171c");
  const camera = new THREE.PerspectiveCamera(data.fovY, 1, 0.01, 100);
  const light = new THREE.DirectionalLight("#ffffff", 2.2);
  camera.add(light);
  scene.add(camera, new THREE.AmbientLight("#ffffff", 0.9));

  const flat = new Float32Array(9 * data.faceCount);
  for (let k = 0; k < 3 * data.faceCount; k++) {
    const vertex = 3 * data.indices[k];
    flat.set(data.positions.subarray(vertex, vertex + 3), 3 * k);
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(flat, 3));
  geometry.setAttribute("color", new THREE.BufferAttribute(faceColors(data), 3));
  geometry.setAttribute("face", new THREE.BufferAttribute(idBytes(data.faceCount), 4, true));
  const ownColors = geometry.getAttribute("color");
  let labelColors = null;
  const material = new THREE.MeshLambertMaterial({ vertexColors: true, flatShading: true, side: THREE.DoubleSide });
  scene.add(new THREE.Mesh(geometry, material));
  // Transparent faces hide nothing.
  const glass = geometry.clone();
  const glassMaterial = material.clone();
  Object.assign(glassMaterial, { transparent: true, opacity: 0.35, depthWrite: false });
  const [solid, clear] = [[], []];
  data.transparent?.forEach((is, face) => (is ? clear : solid).push(face));
  if (clear.length) scene.add(new THREE.Mesh(glass, glassMaterial));

  const idMaterial = new THREE.ShaderMaterial({
    side: THREE.DoubleSide,
    glslVersion: THREE.GLSL3,
    vertexShader: `in vec4 face; flat out vec4 shade;
      void main() { shade = face; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }`,
    fragmentShader: `flat in vec4 shade; out vec4 color; void main() { color = shade; }`,
  });
  const idTarget = new THREE.WebGLRenderTarget(ID_WIDTH, ID_HEIGHT);
  const idScene = new THREE.Scene();
  const idMesh = new THREE.Mesh(geometry.clone(), idMaterial);
  if (clear.length) idMesh.geometry.setIndex(corners(solid));
  idScene.add(idMesh);
  const eyeCamera = new THREE.PerspectiveCamera(data.fovY, ID_WIDTH / ID_HEIGHT, 0.01, 100);

  const sphere = new THREE.Group();
  const wires = new THREE.BufferGeometry();
  wires.setAttribute("position", new THREE.BufferAttribute(data.points.map((x) => x * data.radius), 3));
  wires.setIndex(new THREE.BufferAttribute(data.sphereFaces, 1));
  sphere.add(
    new THREE.LineSegments(new THREE.WireframeGeometry(wires), new THREE.LineBasicMaterial({ color: "#3c4a5c" })),
    new THREE.Points(wires, new THREE.PointsMaterial({ color: "#8fb4e8", size: 4, sizeAttenuation: false })),
  );
  const cellShape = new THREE.BufferGeometry();
  cellShape.setAttribute("position", new THREE.BufferAttribute(new Float32Array(9), 3));
  const cellMesh = new THREE.Mesh(
    cellShape,
    new THREE.MeshBasicMaterial({ color: CELL, transparent: true, opacity: 0.45, side: THREE.DoubleSide }),
  );
  const eyeMark = new THREE.Mesh(
    new THREE.SphereGeometry(data.radius * 0.012),
    new THREE.MeshBasicMaterial({ color: CELL }),
  );
  sphere.add(cellMesh, eyeMark);
  scene.add(sphere);

  const backdrops = new THREE.Group();
  for (let quad = 0; quad < data.quads.length / 12; quad++) {
    const shape = new THREE.BufferGeometry();
    shape.setAttribute("position", new THREE.BufferAttribute(data.quads.slice(12 * quad, 12 * quad + 12), 3));
    shape.setIndex([0, 1, 2, 0, 2, 3]);
    const hue = new THREE.Color().setHSL((quad * 0.61803398875) % 1, 0.6, 0.55);
    backdrops.add(
      new THREE.Mesh(
        shape,
        new THREE.MeshBasicMaterial({ color: hue, transparent: true, opacity: 0.3, side: THREE.DoubleSide }),
      ),
    );
  }
  scene.add(backdrops);

  const missedShape = geometry.clone();
  const missedMesh = new THREE.Mesh(
    missedShape,
    new THREE.MeshBasicMaterial({ color: MISSED, side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: -1 }),
  );
  scene.add(missedMesh);

  const panel = document.createElement("details");
  panel.className = "cyc-panel";
  // On a phone the figures would cover the model.
  panel.open = !matchMedia("(pointer: coarse) and ((max-width: 520px) or (max-height: 520px))").matches;
  const heading = document.createElement("summary");
  const name = document.createElement("h1");
  name.textContent = data.title;
  heading.append(name);
  const figures = document.createElement("dl");
  figures.setAttribute("aria-live", "polite");
  const said = {};
  for (const [name, label] of [
    ["faces", "faces"],
    ["drawn", "drawn"],
    ["culled", "culled"],
    ["missed", "missed"],
    ["cell", "cell"],
  ]) {
    const term = document.createElement("dt");
    term.textContent = label;
    said[name] = document.createElement("dd");
    said[name].dataset.figure = name;
    figures.append(term, said[name]);
  }
  panel.append(heading, figures);
  const controls = {};
  function toggle(name, label, on, hidden = false) {
    const box = document.createElement("input");
    box.type = "checkbox";
    box.checked = on;
    box.name = name;
    const line = document.createElement("label");
    line.append(box, ` ${label}`);
    line.hidden = hidden;
    panel.append(line);
    controls[name] = box;
    box.addEventListener("change", refresh);
  }
  toggle("follow", "the eye follows the view", true);
  toggle("cull", "draw only what the eye may see", true);
  toggle("patches", "colour patches", false, !data.labels);
  toggle("sphere", "sphere of samples", true);
  toggle("missed", "what is missed, in red", false);
  toggle("backdrops", "backdrops of the plan", true, data.quads.length === 0);
  const hint = document.createElement("p");
  hint.textContent = "Drag or arrow keys turn, wheel zooms. Let the eye stay, then look behind what it sees.";
  panel.append(hint);
  root.append(panel);

  // From where +y is up, as three.js has it, to where the model's up is.
  const upright = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 1, 0), new THREE.Vector3(...data.up));
  camera.up.set(...data.up);
  const orbit = new OrbitControls(camera, renderer.domElement);
  orbit.enablePan = false;
  look(new THREE.Vector3(0, 0, 1).applyEuler(new THREE.Euler(-0.35, 0.6, 0)).applyQuaternion(upright));

  const now = { eye: new THREE.Vector3(), cell: -1, drawn: [], set: new Uint8Array(data.faceCount), missed: null };
  let pending = 0;
  let drawing = false;
  let indexed = null; // the cell whose faces are drawn, -1 for all

  /** Puts the view so far away in a direction that the model fills two thirds of it, however far the samples are. */
  function look(direction) {
    const narrow = Math.min(1, root.clientWidth / root.clientHeight || 1);
    camera.position.copy(direction).setLength(1.35 / (narrow * Math.sin((data.fovY * Math.PI) / 360)));
    orbit.update();
  }

  function show(cell) {
    now.cell = cell;
    now.drawn = answered(data, cell);
    now.set.fill(0);
    for (const face of now.drawn) now.set[face] = 1;
    const at = cellShape.getAttribute("position");
    for (let k = 0; k < 3; k++) {
      const p = 3 * data.sphereFaces[3 * cell + k];
      at.setXYZ(k, ...[0, 1, 2].map((axis) => data.points[p + axis] * data.radius));
    }
    at.needsUpdate = true;
    cellShape.computeBoundingSphere();
  }

  function measure() {
    pending = 0;
    eyeCamera.position.copy(now.eye);
    eyeCamera.up.set(0, Math.abs(now.eye.y) > 0.999 * now.eye.length() ? 0 : 1, 0);
    if (eyeCamera.up.y === 0) eyeCamera.up.set(0, 0, 1);
    eyeCamera.lookAt(0, 0, 0);
    // The model lies in a ball of radius 1.
    [eyeCamera.near, eyeCamera.far] = [Math.max(data.radius - 1.01, 0.01), data.radius + 1.01];
    eyeCamera.updateProjectionMatrix();
    const before = renderer.getRenderTarget();
    renderer.setRenderTarget(idTarget);
    renderer.setClearColor(0x000000, 0);
    renderer.clear();
    renderer.render(idScene, eyeCamera);
    renderer.setRenderTarget(before);
    const pixels = new Uint8Array(4 * ID_WIDTH * ID_HEIGHT);
    renderer.readRenderTargetPixels(idTarget, 0, 0, ID_WIDTH, ID_HEIGHT, pixels);
    let covered = 0;
    let missed = 0;
    const lost = new Set();
    for (let at = 0; at < pixels.length; at += 4) {
      const face = pixels[at] + 256 * pixels[at + 1] + 65536 * pixels[at + 2] - 1;
      if (face < 0) continue;
      covered++;
      if (!now.set[face]) {
        missed++;
        lost.add(face);
      }
    }
    now.missed = { covered, missed };
    missedShape.setIndex(corners([...lost]));
    said.missed.textContent = `${missed.toLocaleString("en")} of ${covered.toLocaleString("en")} px`;
    draw();
  }

  function refresh() {
    if (controls.follow.checked || now.cell < 0) {
      now.eye.copy(camera.position).setLength(data.radius);
      const direction = now.eye.clone().normalize().toArray();
      const cell = locate(data.points, data.sphereFaces, direction);
      if (cell !== now.cell) show(cell);
      eyeMark.position.copy(now.eye);
      clearTimeout(pending);
      said.missed.textContent = "…";
      pending = setTimeout(measure, 120);
    }
    if (controls.patches.checked && !labelColors) labelColors = new THREE.BufferAttribute(patchColors(data), 3);
    for (const shape of [geometry, glass]) shape.setAttribute("color", controls.patches.checked ? labelColors : ownColors);
    const culls = controls.cull.checked;
    const asked = culls ? now.cell : -1;
    if (asked !== indexed) {
      indexed = asked;
      const shown = clear.length ? [[geometry, solid], [glass, clear]] : [];
      for (const [shape, faces] of shown) shape.setIndex(corners(culls ? faces.filter((face) => now.set[face]) : faces));
      if (!clear.length) geometry.setIndex(culls ? corners(now.drawn) : null);
    }
    sphere.visible = controls.sphere.checked;
    cellMesh.visible = eyeMark.visible = !controls.follow.checked; // else they are before the model
    backdrops.visible = controls.backdrops.checked;
    missedMesh.visible = controls.missed.checked;
    said.faces.textContent = data.faceCount.toLocaleString("en");
    said.drawn.textContent = now.drawn.length.toLocaleString("en");
    said.culled.textContent = `${(100 * (1 - now.drawn.length / data.faceCount)).toFixed(1)} %`;
    said.cell.textContent = `${now.cell} of ${data.sphereFaces.length / 3}`;
    draw();
  }

  function draw() {
    if (drawing) return;
    drawing = true;
    requestAnimationFrame(() => {
      drawing = false;
      const [away, around] = [camera.position.length(), 1.1 * Math.max(data.radius, 1)];
      [camera.near, camera.far] = [Math.max(away - around, away / 1000), away + around];
      camera.updateProjectionMatrix();
      renderer.render(scene, camera);
    });
  }

  function turn(event) {
    const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!steps) return;
    event.preventDefault();
    const place = new THREE.Spherical().setFromVector3(camera.position.applyQuaternion(upright.clone().invert()));
    place.theta += 0.08 * steps[0];
    place.phi = Math.min(Math.max(place.phi + 0.08 * steps[1], 0.01), Math.PI - 0.01);
    camera.position.setFromSpherical(place).applyQuaternion(upright);
    orbit.update();
  }

  function fit() {
    const width = root.clientWidth || 640;
    const height = root.clientHeight || 480;
    renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    renderer.setSize(width, height, false);
    renderer.domElement.style.width = "100%";
    renderer.domElement.style.height = "100%";
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    draw();
  }

  orbit.addEventListener("change", refresh);
  renderer.domElement.addEventListener("keydown", turn);
  const watcher = new ResizeObserver(fit);
  watcher.observe(root);
  fit();
  refresh();

  return {
    state: () => ({
      cell: now.cell,
      drawn: now.drawn.length,
      eye: now.eye.toArray(),
      missed: now.missed,
      up: new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, 1).toArray(),
    }),
    look(direction) {
      look(new THREE.Vector3().fromArray(direction));
      refresh();
    },
    dispose() {
      clearTimeout(pending);
      watcher.disconnect();
      orbit.dispose();
      for (const thing of [geometry, glass, idMesh.geometry, missedShape, wires, cellShape]) thing.dispose();
      idTarget.dispose();
      renderer.dispose();
      root.remove();
    },
  };
}
