// The lamp drawn with WebGL 2: light is summed in floating point in a picture of its own, which values are read from, and then shown.
import { falseColours, ofZone, RGB_FROM_XYZ } from "./colour.js";
import * as shaders from "./shaders.js";
import { DRAWN, send, simpler } from "./simpler.js";
import { solidOf } from "./solid.js";

const HINTS = 2048;
const UNCUT = [[0, 0, 0, 1], [0, 0, 0, 1], [0, 0, 0, 1]];
/** Colours of the stages of a hull: projected, stitched, filled. */
const STAGES = [[0.85, 0.25, 0.22], [0.25, 0.68, 0.32], [0.25, 0.45, 0.9]];
const MOST_LAYERS = 256;
/** Triangles of pictures that move, where all of them took too long. */
const FEW_TRIANGLES = 2000;
/**
 * What the greatest M q becomes in a half float, which ends at 65 504: two sheets seen at the edge (1/|cos θ| up to 1000) are still
 * held, and three digits are kept to 2e-6 of it, which is what narrow beams are from the side.
 */
const BRIGHTEST = 32;

export class Picture {
  constructor(canvas, lamp) {
    const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, preserveDrawingBuffer: true });
    if (!gl || !gl.getExtension("EXT_color_buffer_float")) throw new Error("WebGL 2 with floating point is missing");
    Object.assign(this, { canvas, gl, lamp, size: [0, 0] });
    this.colours = this.texture(gl.TEXTURE_2D, gl.RGBA8, [256, 1], gl.RGBA, gl.UNSIGNED_BYTE, falseColours(), gl.LINEAR);
    this.loadDirections();
    this.loadSurface();
    if (lamp.volume) this.loadVolume();
    this.show = {};
    for (const way of ["false", "true", "plain"]) this.show[way] = this.program(shaders.everywhere, shaders.shown(way));
    this.frame = gl.createFramebuffer();
  }

  program(vertex, fragment) {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    const uniforms = {};
    for (let k = 0; k < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); k += 1) {
      const { name } = gl.getActiveUniform(program, k);
      uniforms[name] = gl.getUniformLocation(program, name);
    }
    return { program, uniforms };
  }

  texture(target, internal, size, format, type, data, filter) {
    const { gl } = this;
    const texture = gl.createTexture();
    gl.bindTexture(target, texture);
    for (const [name, value] of [["MIN_FILTER", filter], ["MAG_FILTER", filter]]) gl.texParameteri(target, gl[`TEXTURE_${name}`], value);
    for (const name of ["WRAP_S", "WRAP_T", "WRAP_R"]) gl.texParameteri(target, gl[`TEXTURE_${name}`], gl.CLAMP_TO_EDGE);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    if (target === gl.TEXTURE_2D) gl.texImage2D(target, 0, internal, ...size, 0, format, type, data);
    else gl.texImage3D(target, 0, internal, ...size, 0, format, type, data);
    return texture;
  }

  /** q at the nodes of all zones (or of the whole, for a volume), and where a γ is among its nodes. */
  loadDirections() {
    const { gl, lamp } = this;
    const { directions } = lamp;
    const [gammas, planes] = [directions.gamma.length, directions.c.length];
    const make = (tables) => {
      const inLayer = Math.max(1, Math.ceil(tables.length / Math.min(MOST_LAYERS, gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS))));
      const layers = Math.ceil(tables.length / inLayer);
      const data = new Float32Array(4 * gammas * planes * inLayer * layers);
      tables.forEach((table, k) => data.set(table, 4 * gammas * planes * k));
      const size = [gammas, planes * inLayer, layers];
      return { inLayer, texture: this.texture(gl.TEXTURE_2D_ARRAY, gl.RGBA32F, size, gl.RGBA, gl.FLOAT, data, gl.NEAREST) };
    };
    this.zoneQ = make(lamp.q);
    this.totalQ = make([lamp.total]);
    const width = Math.max(HINTS, gammas);
    const nodes = new Float32Array(2 * width);
    directions.gamma.forEach((gamma, k) => { nodes[k] = (gamma * Math.PI) / 180; });
    for (let column = 0, k = 0; column < width; column += 1) {
      while (k < gammas - 2 && directions.gamma[k + 1] <= (180 * column) / width) k += 1;
      nodes[width + column] = k;
    }
    this.gammaNodes = this.texture(gl.TEXTURE_2D, gl.R32F, [width, 2], gl.RED, gl.FLOAT, nodes, gl.NEAREST);
    this.counts = [gammas, planes, width];
  }

  loadSurface() {
    const { gl, lamp } = this;
    const mixtures = Array.from({ length: lamp.triangles }, (_, triangle) => lamp.mixture(triangle));
    const sets = Math.min(3, Math.max(1, ...mixtures.map((mixture) => Math.ceil(mixture.size / 4))));
    const width = 13 + 8 * sets;
    const data = new Float32Array(3 * lamp.triangles * width);
    mixtures.forEach((mixture, triangle) => {
      const { normal } = lamp.normal(triangle);
      const zones = [...mixture].slice(0, 4 * sets);
      const [main] = [...zones].sort((a, b) => sum(b[1]) - sum(a[1]))[0] ?? [0];
      for (let corner = 0; corner < 3; corner += 1) {
        const at = (3 * triangle + corner) * width;
        const vertex = lamp.indices[3 * triangle + corner];
        data.set(lamp.corner(triangle, corner), at);
        data.set(normal, at + 3);
        data.set(lamp.exitance.subarray(4 * vertex, 4 * vertex + 4), at + 6);
        data.set([main, lamp.stages ? lamp.stages.values[triangle] : 0, 0], at + 10);
        zones.forEach(([zone, corners], k) => {
          data[at + 13 + 8 * (k >> 2) + (k & 3)] = zone;
          data[at + 13 + 8 * (k >> 2) + 4 + (k & 3)] = corners[corner];
        });
      }
    });
    this.sets = sets;
    this.light = this.program(shaders.surfaceVertex(sets), shaders.surfaceLight(sets));
    this.loadVertices();
    this.facts = this.program(shaders.surfaceVertex(sets), shaders.surfaceFacts);
    this.rows = { data, width, buffer: gl.createBuffer() };
    gl.bindBuffer(gl.ARRAY_BUFFER, this.rows.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    let [most, mostW] = [0, 0];
    for (let k = 0; k < lamp.exitance.length; k += 4) {
      most = Math.max(most, lamp.exitance[k + 1]);
      mostW = Math.max(mostW, lamp.exitance[k + 3]);
    }
    this.mostExitance = lamp.isLuminous ? most : mostW;
    this.scale = (this.mostExitance * greatestQ(lamp.q, lamp, 1 / Math.PI)) / BRIGHTEST || 1;
  }

  /** The vertices by themselves, for pictures that move: place, light, and up to four zones with their weights. */
  loadVertices() {
    const { gl, lamp } = this;
    const count = lamp.positions.length / 3;
    const data = new Float32Array(15 * count);
    for (let k = 0; k < count; k += 1) {
      data.set(lamp.positions.subarray(3 * k, 3 * k + 3), 15 * k);
      data.set(lamp.exitance.subarray(4 * k, 4 * k + 4), 15 * k + 3);
      data.set(lamp.zoneIds.subarray(4 * k, 4 * k + 4), 15 * k + 7);
      data.set(lamp.zoneWeights.subarray(4 * k, 4 * k + 4), 15 * k + 11);
    }
    this.moving = {
      ...this.program(shaders.movingVertex, shaders.movingLight),
      ...this.stored(data, Uint32Array.from(lamp.indices)), places: [["position", 3, 0], ["light", 4, 3], ["zones", 4, 7], ["weights", 4, 11]],
    };
  }

  /** The same with few triangles, made when it is first asked for. */
  few() {
    if (!this.simple) {
      const { vertices, indices } = simpler(this.lamp, FEW_TRIANGLES);
      const rows = new Float32Array(DRAWN * (vertices.places.length / 3));
      this.simple = {
        ...this.program(shaders.knownVertex, shaders.movingLight), ...this.stored(rows, indices),
        places: [["position", 3, 0], ["light", 4, 3]], vertices, rows,
      };
    }
    return this.simple;
  }

  /** Rows of numbers and the order in which they make triangles, for `drawIndexed`. */
  stored(rows, indices) {
    const { gl } = this;
    const [buffer, order] = [gl.createBuffer(), gl.createBuffer()];
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, rows, gl.STATIC_DRAW);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, order);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    return { buffer, order, corners: indices.length };
  }

  drawIndexed({ program, buffer, order, corners, places }) {
    const { gl } = this;
    const width = places.reduce((sum, [, count]) => sum + count, 0);
    for (let k = 0; k < 16; k += 1) gl.disableVertexAttribArray(k);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    for (const [name, count, at] of places) {
      const location = gl.getAttribLocation(program, name);
      gl.enableVertexAttribArray(location);
      gl.vertexAttribPointer(location, count, gl.FLOAT, false, 4 * width, 4 * at);
    }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, order);
    gl.drawElements(gl.TRIANGLES, corners, gl.UNSIGNED_INT, 0);
  }

  loadVolume() {
    const { gl } = this;
    const { cells, nodes, lit } = this.lamp.volume;
    this.nodes = this.texture(gl.TEXTURE_3D, gl.RGBA32F, cells.map((count) => count + 1), gl.RGBA, gl.FLOAT, nodes, gl.NEAREST);
    this.lit = this.texture(gl.TEXTURE_3D, gl.R8, cells, gl.RED, gl.UNSIGNED_BYTE, lit, gl.NEAREST);
    this.march = this.program(shaders.everywhere, shaders.volumeLight(false));
    this.movingMarch = this.program(shaders.everywhere, shaders.volumeLight(true));
    const { pitch, greatest } = this.lamp.volume;
    const component = this.lamp.isLuminous ? 1 : 3;
    let most = 0;
    for (let k = component; k < greatest.length; k += 4) most = Math.max(most, greatest[k]);
    // Half floats, which a texture unit interpolates everywhere, end at 65 504: j in units of its greatest.
    this.mostLight = most || 1;
    const parts = nodes.map((value) => Math.min(value / this.mostLight, 60_000));
    this.smoothNodes = this.texture(gl.TEXTURE_3D, gl.RGBA16F, cells.map((count) => count + 1), gl.RGBA, gl.FLOAT, parts, gl.LINEAR);
    this.volumeScale = (most * Math.hypot(...pitch.map((step, k) => step * cells[k])) * greatestQ([this.lamp.total], this.lamp, 1 / (4 * Math.PI))) / BRIGHTEST || 1;
  }

  /** The picture's own size; the canvas shows it as large as it is. */
  resize(width, height) {
    if (this.size[0] === width && this.size[1] === height) return;
    const { gl } = this;
    this.size = [width, height];
    [this.canvas.width, this.canvas.height] = this.size;
    for (const old of [this.summed, this.depth]) if (old) (old === this.depth ? gl.deleteRenderbuffer(old) : gl.deleteTexture(old));
    this.summed = this.texture(gl.TEXTURE_2D, gl.RGBA16F, this.size, gl.RGBA, gl.HALF_FLOAT, null, gl.NEAREST);
    this.depth = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, this.depth);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, ...this.size);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.summed, 0);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, this.depth);
  }

  /** What one unit of the summed picture is: lm or W per mm² and sr, or per mm² of exitance. */
  unit(mode) {
    if (mode === "exitance") return this.mostExitance || 1;
    return this.volumeScale ?? this.scale;
  }

  /**
   * Sums light (or facts of the surface) as seen by `camera`; coarsely while it moves. `cuts`: normals and places of three planes beyond
   * which nothing is shown.
   */
  sum(camera, mode, isCoarse = false, cuts = UNCUT) {
    const { gl } = this;
    const aspect = this.size[0] / this.size[1];
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    gl.viewport(0, 0, ...this.size);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const isLight = mode === "seen" || mode === "true";
    if (isLight && this.lamp.volume) return this.sumVolume(camera, aspect, isCoarse, cuts);
    if (mode === "solid") return this.sumSolid(camera, aspect, cuts);
    const used = !isLight ? this.facts : !isCoarse ? this.light : this.isSlow ? this.few() : this.moving;
    const { program, uniforms } = used;
    this.begin(used, camera, aspect, cuts);
    gl.uniform1f(uniforms.scale, this.unit(mode));
    if (isLight && !used.vertices) this.bindDirections(uniforms, this.zoneQ);
    if (!isLight) gl.uniform1i(uniforms.is_exitance, mode === "exitance" ? 1 : 0);
    // The surface carries light and blocks none: what lies behind adds to what lies before.
    (isLight ? gl.enable : gl.disable).call(gl, gl.BLEND);
    (isLight ? gl.disable : gl.enable).call(gl, gl.DEPTH_TEST);
    gl.blendFunc(gl.ONE, gl.ONE);
    if (used.vertices) {
      send(this.lamp, used.vertices, camera.eye(), this.unit(mode), used.rows);
      gl.bindBuffer(gl.ARRAY_BUFFER, used.buffer);
      gl.bufferData(gl.ARRAY_BUFFER, used.rows, gl.DYNAMIC_DRAW);
    }
    if (used.order) return this.drawIndexed(used);
    this.rowsInto(program, mode);
    return gl.drawArrays(gl.TRIANGLES, 0, 3 * this.lamp.triangles);
  }

  /** What all pictures of surfaces need. */
  begin({ program, uniforms }, camera, aspect, cuts) {
    const { gl } = this;
    gl.useProgram(program);
    const { clip, eye } = camera.matrices(aspect);
    gl.uniformMatrix4fv(uniforms.clip_from_source, false, clip);
    gl.uniform3fv(uniforms.eye, eye);
    gl.uniform4fv(uniforms["cuts[0]"], cuts.flat());
  }

  /** The photometric solid, made when it is first asked for: as large as the lamp is shown. */
  solidOf(camera) {
    if (!this.solid) {
      const solid = solidOf(this.lamp, camera.middle, camera.radius);
      this.solid = {
        ...solid, ...this.program(shaders.solidVertex, shaders.solidFacts), ...this.stored(solid.rows, solid.indices),
        places: [["position", 3, 0], ["normal", 3, 3], ["category", 3, 6]],
      };
    }
    return this.solid;
  }

  sumSolid(camera, aspect, cuts) {
    const { gl } = this;
    const solid = this.solidOf(camera);
    this.begin(solid, camera, aspect, cuts);
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
    this.drawIndexed(solid);
  }

  rowsInto(program, mode) {
    const { gl } = this;
    const { width, buffer, data } = this.rows;
    if (mode !== "seen" && mode !== "true" && this.coloured !== mode) this.recolour(data, width, mode);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    const places = [["position", 3, 0], ["normal", 3, 3], ["light", 4, 6]];
    for (let k = 0; k < this.sets; k += 1) places.push([`zones${k}`, 4, 13 + 8 * k], [`weights${k}`, 4, 17 + 8 * k]);
    for (let k = 0; k < 16; k += 1) gl.disableVertexAttribArray(k);
    for (const [name, count, at] of places) {
      const location = gl.getAttribLocation(program, name);
      if (location < 0) continue;
      gl.enableVertexAttribArray(location);
      gl.vertexAttribPointer(location, count, gl.FLOAT, false, 4 * width, 4 * at);
    }
    const location = gl.getAttribLocation(program, "category");
    if (location < 0 || !this.categories) return;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.categories);
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, 3, gl.FLOAT, false, 0, 0);
  }

  /** A colour for each corner: of its triangle's zone or stage. */
  recolour(data, width, mode) {
    const { gl } = this;
    const colours = new Float32Array(data.length / width * 3);
    for (let row = 0; row < colours.length / 3; row += 1) {
      const [zone, stage] = [data[row * width + 10], data[row * width + 11]];
      colours.set(mode === "zones" ? ofZone(zone) : STAGES[stage] ?? STAGES[0], 3 * row);
    }
    this.categories ??= gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.categories);
    gl.bufferData(gl.ARRAY_BUFFER, colours, gl.STATIC_DRAW);
    this.coloured = mode;
  }

  sumVolume(camera, aspect, isCoarse, cuts) {
    const { gl } = this;
    const { program, uniforms } = isCoarse ? this.movingMarch : this.march;
    const { cells, min, pitch } = this.lamp.volume;
    gl.useProgram(program);
    gl.disable(gl.BLEND);
    gl.disable(gl.DEPTH_TEST);
    for (let k = 0; k < 16; k += 1) gl.disableVertexAttribArray(k);
    gl.uniformMatrix4fv(uniforms.source_from_clip, false, camera.unclip(aspect));
    gl.uniform3fv(uniforms.eye, camera.eye());
    gl.uniform4fv(uniforms["cuts[0]"], cuts.flat());
    gl.uniform1f(uniforms.scale, isCoarse ? this.volumeScale / this.mostLight : this.volumeScale);
    gl.uniform3fv(uniforms.least, min);
    gl.uniform3fv(uniforms.pitch, pitch);
    gl.uniform3iv(uniforms.cells, cells);
    gl.uniform1i(uniforms.steps, Math.min((isCoarse ? 1 : 3) * Math.max(...cells), isCoarse ? 48 : 192));
    this.bindDirections(uniforms, this.totalQ);
    this.bind(2, gl.TEXTURE_3D, isCoarse ? this.smoothNodes : this.nodes, uniforms.j_nodes);
    this.bind(3, gl.TEXTURE_3D, this.lit, uniforms.lit_cells);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  bind(unit, target, texture, uniform) {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(target, texture);
    gl.uniform1i(uniform, unit);
  }

  bindDirections(uniforms, { inLayer, texture }) {
    const { gl, lamp } = this;
    const { x, y, z } = lamp.directions;
    this.bind(0, gl.TEXTURE_2D_ARRAY, texture, uniforms.q_nodes);
    this.bind(1, gl.TEXTURE_2D, this.gammaNodes, uniforms.gamma_nodes);
    const [gammas, planes, width] = this.counts;
    gl.uniform4i(uniforms.counts, gammas, planes, inLayer, width);
    gl.uniformMatrix3fv(uniforms.photometric, false, [0, 1, 2].flatMap((k) => [x[k], y[k], z[k]]));
  }

  /** Shows what was summed: `greatest` is the brightest that still has a colour of its own, in units of the sum. */
  draw(mode, { greatest, decades }) {
    const { gl } = this;
    const ways = { seen: "false", exitance: "false", true: "true" };
    const { program, uniforms } = this.show[ways[mode] ?? "plain"];
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, ...this.size);
    gl.disable(gl.BLEND);
    gl.disable(gl.DEPTH_TEST);
    for (let k = 0; k < 16; k += 1) gl.disableVertexAttribArray(k);
    gl.useProgram(program);
    gl.activeTexture(gl.TEXTURE0);
    this.bind(0, gl.TEXTURE_2D, this.summed, uniforms.summed);
    this.bind(1, gl.TEXTURE_2D, this.colours, uniforms.colours);
    gl.uniform1i(uniforms.component, this.lamp.isLuminous ? 1 : 3);
    gl.uniform1f(uniforms.greatest, greatest);
    gl.uniform1f(uniforms.decades, decades);
    gl.uniformMatrix3fv(uniforms.rgb_from_xyz, false, RGB_FROM_XYZ);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** Waits until all that was asked for is drawn. `gl.finish()` does not wait in all browsers. */
  finish() {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  }

  /** X, Y, Z and radiant of pixels of the sum, lm or W per mm² and sr (per mm² of exitance). */
  read(x, y, width, height, mode) {
    const { gl } = this;
    const out = new Float32Array(4 * width * height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    gl.readPixels(x, y, width, height, gl.RGBA, gl.FLOAT, out);
    const unit = this.unit(mode);
    return out.map((value) => value * unit);
  }
}

/** The greatest q of tables, 1/sr, at least `least`: a narrow beam's is far above the 1/π of a Lambertian source. */
function greatestQ(tables, lamp, least) {
  let most = least;
  for (const table of tables) for (let k = lamp.isLuminous ? 1 : 3; k < table.length; k += 4) most = Math.max(most, table[k]);
  return most;
}

const sum = (values) => values.reduce((total, value) => total + value, 0);
