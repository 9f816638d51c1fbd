// Draws all panels with one WebGL context: a browser gives a page about sixteen.

import { Camera, Geometry, Mesh, Program, Renderer, Texture } from "ogl";
import { FIELD, FRONT, eyeOf } from "./camera.js";
import { COLORS, PLAIN } from "./colors.js";
import { corners, edgesOf } from "./decode.js";

const BACK = [0.42, 0.52, 0.7]; // of faces that are seen from behind
const MOST_PIXELS = 16e6; // of the drawing buffer

const VERTEX = `#version 300 es
in vec3 position; in vec3 normal; in float error;
uniform mat4 modelViewMatrix, projectionMatrix; uniform float uPoint;
out vec3 vPlace, vNormal, vView; out float vError;
void main() {
  vec4 view = modelViewMatrix * vec4(position, 1.0);
  vPlace = position; vNormal = mat3(modelViewMatrix) * normal; vView = view.xyz; vError = error / 255.0;
  gl_Position = projectionMatrix * view;
  gl_PointSize = clamp(uPoint / -view.z, 1.5, 24.0);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
in vec3 vPlace, vNormal, vView; in float vError;
uniform sampler2D uColors; uniform vec3 uPlain, uBack; uniform vec4 uSlice; uniform float uError, uKind, uSliced;
uniform vec4 uLine;
out vec4 color;
void main() {
  if (uSliced > 0.5 && dot(uSlice.xyz, vPlace) > uSlice.w) discard;
  if (uKind > 1.5) { color = vec4(uLine.rgb * uLine.a, uLine.a); return; }
  bool points = uKind > 0.5;
  if (points && length(gl_PointCoord - 0.5) > 0.5) discard;
  float size = length(vNormal);
  vec3 normal = size > 0.0 ? vNormal / size : vec3(0.0);
  bool back;
  if (points) {
    back = dot(normal, vView) > 0.0;
    if (back) normal = -normal;
  } else {
    back = !gl_FrontFacing;
    if (back) normal = -normal;
  }
  float light = size > 0.0 ? 0.38 + 0.62 * max(dot(normal, normalize(vec3(-0.35, 0.45, 0.82))), 0.0) : 0.9;
  vec3 base = uPlain;
  if (uError > 0.5) {
    base = texture(uColors, vec2((vError * 255.0 + 0.5) / 256.0, 0.5)).rgb;
    light = mix(1.0, light, 0.42);
    if (back && uSliced > 0.5) base = mix(base, uBack, 0.65);
  } else if (back && size > 0.0) base = uBack;
  color = vec4(base * light, 1.0);
}`;

export class Drawing {
  /** Throws where there is no WebGL 2. */
  constructor(canvas) {
    const options = { alpha: true, antialias: true, premultipliedAlpha: true };
    if (!canvas.getContext("webgl2", { ...options, depth: true, stencil: false })) throw new Error("no WebGL 2");
    this.canvas = canvas;
    this.renderer = new Renderer({ canvas, ...options, autoClear: false });
    const gl = (this.gl = this.renderer.gl);
    const image = new Uint8Array(256 * 4).fill(255);
    for (let i = 0; i < 256; i++) image.set(COLORS[i], 4 * i);
    const filter = { minFilter: gl.LINEAR, magFilter: gl.LINEAR, wrapS: gl.CLAMP_TO_EDGE, wrapT: gl.CLAMP_TO_EDGE };
    this.uniforms = {
      uColors: { value: new Texture(gl, { image, width: 256, height: 1, generateMipmaps: false, flipY: false, ...filter }) },
      uPlain: { value: PLAIN.map((x) => x / 255) },
      uBack: { value: BACK },
      uSlice: { value: [0, 0, 1, 0] },
      uSliced: { value: 0 },
      uError: { value: 0 },
      uKind: { value: 0 },
      uPoint: { value: 1 },
      uLine: { value: [0.08, 0.08, 0.1, 0.36] }, // dark in every theme: surfaces are light
    };
    const sources = { vertex: VERTEX, fragment: FRAGMENT, uniforms: this.uniforms, cullFace: false };
    this.program = new Program(gl, sources);
    this.lines = new Program(gl, { ...sources, transparent: true, depthWrite: false });
    this.camera = new Camera(gl, { fov: FIELD, near: 0.02, far: 100 });
    this.camera.up.set(0, 0, 1);
    this.models = new Map();
  }

  /** The buffers of a shape, made when it is first drawn. */
  model(shape) {
    if (this.models.has(shape)) return this.models.get(shape);
    const { gl } = this;
    const buffers = ({ positions, normals, errors }) => ({
      position: { size: 3, data: positions },
      normal: { size: 3, data: normals ?? new Float32Array(positions.length) },
      error: { size: 1, data: errors ?? new Uint8Array(positions.length / 3), type: gl.UNSIGNED_BYTE },
    });
    const mesh = (attributes, program, mode) =>
      new Mesh(gl, { geometry: new Geometry(gl, attributes), program, mode, frustumCulled: false });
    const model = { spacing: spacingOf(shape) };
    const once = (name, made) => () => (model[`_${name}`] ??= made());
    model.points = once("points", () => mesh(buffers(shape), this.program, gl.POINTS));
    if (shape.faces) {
      const edges = () => ({ ...buffers(shape), index: { data: edgesOf(shape.faces, shape.count) } });
      model.surface = once("surface", () => mesh(buffers(corners(shape)), this.program, gl.TRIANGLES));
      model.edges = once("edges", () => mesh(edges(), this.lines, gl.LINES));
    }
    this.models.set(shape, model);
    return model;
  }

  /** The size of the canvas in CSS pixels; its buffer has as many as the screen, up to a bound. */
  resize(width, height) {
    const most = Math.min(1, Math.sqrt(MOST_PIXELS / Math.max(1, width * height * devicePixelRatio ** 2)));
    const ratio = Math.min(devicePixelRatio * most, 8192 / Math.max(width, height, 1));
    if (this.width === width && this.height === height && this.ratio === ratio) return;
    Object.assign(this, { width, height, ratio });
    this.renderer.dpr = ratio;
    this.renderer.setSize(width, height);
  }

  clear() {
    const { gl } = this;
    this.renderer.setDepthMask(true);
    gl.disable(gl.SCISSOR_TEST);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  /**
   * One panel.
   * @param {object} shape as unpack gives it
   * @param {{x, y, width, height}} box in CSS pixels from the canvas's upper left corner
   * @param {{camera, mode, style, slice, ink}} view
   */
  draw(shape, box, { camera, mode, style, slice }) {
    const { gl, uniforms, ratio } = this;
    const at = [box.width, box.height, box.x, this.height - box.y - box.height].map((x) => Math.round(x * ratio));
    gl.viewport(at[2], at[3], at[0], at[1]); // not the renderer's, which takes equal sizes for the same place
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(at[2], at[3], at[0], at[1]);
    const aspect = box.width / box.height;
    const half = Math.tan((FIELD * Math.PI) / 360) / Math.min(1, aspect);
    this.camera.perspective({ fov: (360 / Math.PI) * Math.atan(half), aspect, near: camera[2] / 100, far: camera[2] + 20 });
    this.camera.position.set(...eyeOf(camera));
    this.camera.lookAt(camera.slice(3));
    this.camera.updateMatrixWorld();
    const model = this.model(shape);
    uniforms.uError.value = mode === "error" && shape.errors ? 1 : 0;
    uniforms.uSliced.value = slice ? 1 : 0;
    if (slice) {
      const sign = FRONT[slice.axis] * (slice.flipped ? -1 : 1);
      uniforms.uSlice.value = [...["x", "y", "z"].map((axis) => (axis === slice.axis ? sign : 0)), sign * slice.at];
    }
    uniforms.uPoint.value = (model.spacing * 0.8 * at[1]) / (2 * half);
    const draw = (scene, kind) => {
      uniforms.uKind.value = kind;
      scene.draw({ camera: this.camera }); // not renderer.render, which sets a viewport of its own
    };
    if (!model.surface || style === "points") return draw(model.points(), 1);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1, 1);
    draw(model.surface(), 0);
    gl.disable(gl.POLYGON_OFFSET_FILL);
    if (style === "edges") draw(model.edges(), 2);
  }

  dispose() {
    this.gl.getExtension("WEBGL_lose_context")?.loseContext();
    this.models.clear();
  }
}

/** About how far neighbours are from each other: the area of the box's sides, shared among the points. */
function spacingOf({ positions, count }) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < positions.length; i++) {
    low[i % 3] = Math.min(low[i % 3], positions[i]);
    high[i % 3] = Math.max(high[i % 3], positions[i]);
  }
  const [a, b, c] = high.map((x, k) => x - low[k]);
  return Math.sqrt((2 * (a * b + b * c + c * a)) / Math.max(1, count)) || 0.01;
}
