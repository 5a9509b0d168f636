// The formulas of openapi/README.md in GLSL ES 3.00. Pictures are made in two steps: light is summed in floating point (X, Y, Z and
// radiant, in units of `scale`), then it is shown in false or true colour. Values are read from the first step.

const HEAD = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2DArray;
precision highp sampler3D;
`;

/** q of the zones in a direction, by section 3: bilinear in C and γ between nodes. */
const DISTRIBUTION = `
uniform sampler2DArray q_nodes;      // x: γ, y: C of one zone below the other, layer: zones
uniform sampler2D gamma_nodes;       // row 0: γ of node, radians; row 1: node at or before γ = π x / width
uniform ivec4 counts;                // nodes of γ, of C, zones in a layer, width of gamma_nodes
uniform mat3 photometric;            // rows: e_x, e_y, e_z in the source frame

struct Nodes { int k; float t; int j; int next; float s; };

Nodes nodes_of(vec3 direction) {
  vec3 p = photometric * direction;
  float gamma = atan(length(p.xy), -p.z);
  float turn = atan(p.y, p.x) / 6.283185307179586;
  turn = (turn < 0.0 ? turn + 1.0 : turn) * float(counts.y);
  Nodes n;
  int last = counts.x - 2;
  int column = min(int(gamma / 3.141592653589793 * float(counts.w)), counts.w - 1);
  n.k = min(int(texelFetch(gamma_nodes, ivec2(column, 1), 0).r), last);
  float from = texelFetch(gamma_nodes, ivec2(n.k, 0), 0).r;
  float to = texelFetch(gamma_nodes, ivec2(n.k + 1, 0), 0).r;
  for (int guard = 0; guard < 512 && n.k < last && gamma >= to; guard++) {
    n.k += 1;
    from = to;
    to = texelFetch(gamma_nodes, ivec2(n.k + 1, 0), 0).r;
  }
  n.t = clamp((gamma - from) / (to - from), 0.0, 1.0);
  n.s = fract(turn);
  n.j = int(turn) % counts.y;
  n.next = (n.j + 1) % counts.y;
  if (counts.y == 1) n.s = 0.0;
  return n;
}

vec4 q_of(int zone, Nodes n) {
  int layer = zone / counts.z;
  int row = (zone % counts.z) * counts.y;
  vec4 a = mix(texelFetch(q_nodes, ivec3(n.k, row + n.j, layer), 0), texelFetch(q_nodes, ivec3(n.k + 1, row + n.j, layer), 0), n.t);
  if (n.s == 0.0) return a;
  vec4 b = mix(texelFetch(q_nodes, ivec3(n.k, row + n.next, layer), 0), texelFetch(q_nodes, ivec3(n.k + 1, row + n.next, layer), 0), n.t);
  return mix(a, b, n.s);
}
`;

/** What lies beyond a plane of a cut is left out: `cuts` are unit normals and how far along them the cuts are, mm; a normal of 0 cuts nothing. */
const CUT = `
uniform vec4 cuts[3];
bool is_cut(vec3 at) {
  return dot(cuts[0].xyz, at) > cuts[0].w || dot(cuts[1].xyz, at) > cuts[1].w || dot(cuts[2].xyz, at) > cuts[2].w;
}
`;

/** Vertices of the surface; `sets` times four zones for each triangle, with weights that are linear over it. */
export function surfaceVertex(sets) {
  const places = [0, 1, 2].slice(0, sets);
  return `${HEAD}
in vec3 position; in vec3 normal; in vec4 light; in vec3 category;
${places.map((k) => `in vec4 zones${k}; in vec4 weights${k}; flat out vec4 zone${k}; out vec4 weight${k};`).join("\n")}
uniform mat4 clip_from_source;
out vec3 place; out vec4 exitance; flat out vec3 across; flat out vec3 colour;
void main() {
  place = position; exitance = light; across = normal; colour = category;
  ${places.map((k) => `zone${k} = zones${k}; weight${k} = weights${k};`).join(" ")}
  gl_Position = clip_from_source * vec4(position, 1.0);
}`;
}

/** L = M q / |cos θ| towards the eye. */
export function surfaceLight(sets) {
  const places = [0, 1, 2].slice(0, sets);
  return `${HEAD}${DISTRIBUTION}${CUT}
in vec3 place; in vec4 exitance; flat in vec3 across;
${places.map((k) => `flat in vec4 zone${k}; in vec4 weight${k};`).join("\n")}
uniform vec3 eye; uniform float scale;
out vec4 seen;
void main() {
  if (is_cut(place)) discard;
  vec3 direction = normalize(eye - place);
  Nodes n = nodes_of(direction);
  vec4 q = vec4(0.0);
  ${places.map((k) => `for (int i = 0; i < 4; i++) if (weight${k}[i] > 0.0) q += weight${k}[i] * q_of(int(zone${k}[i]), n);`).join("\n  ")}
  seen = exitance * q / max(abs(dot(across, direction)), 1e-3) / scale;
}`;
}

/** For pictures that move: q is found at the vertices alone, each once, and M q is linear between them. */
export const movingVertex = `${HEAD}${DISTRIBUTION}
in vec3 position; in vec4 light; in vec4 zones; in vec4 weights;
uniform mat4 clip_from_source; uniform vec3 eye; uniform float scale;
out vec3 place; out vec4 sent;
void main() {
  place = position;
  Nodes n = nodes_of(normalize(eye - position));
  vec4 q = vec4(0.0);
  for (int i = 0; i < 4; i++) if (weights[i] > 0.0) q += weights[i] * q_of(int(zones[i]), n);
  sent = light * q / scale;
  gl_Position = clip_from_source * vec4(position, 1.0);
}`;

/** The same of vertices whose M q is known. */
export const knownVertex = `${HEAD}
in vec3 position; in vec4 light;
uniform mat4 clip_from_source;
out vec3 place; out vec4 sent;
void main() {
  place = position; sent = light;
  gl_Position = clip_from_source * vec4(position, 1.0);
}`;

/** The same between the vertices: a point shines by M q / |cos θ|, θ the angle between the line of sight and the normal of its triangle. Few
 * triangles lie in other directions than the surface does. At its rim, where they are seen from the side, their θ is wrong and the quotient has
 * no bound, so |cos θ| counts as 0.02 at least: nothing there is brighter than 50 M q. The neighbouring pixels tell the normal. */
export const movingLight = `${HEAD}${CUT}
in vec3 place; in vec4 sent;
uniform vec3 eye;
out vec4 seen;
void main() {
  vec3 across = cross(dFdx(place), dFdy(place));
  if (is_cut(place)) discard;
  vec3 way = eye - place;
  float whole = length(way) * length(across);
  seen = sent * (whole / max(abs(dot(across, way)), max(0.02 * whole, 1e-30)));
}`;

/** The photometric solid: a surface as far from its middle as the intensity is great, shaded by its own form. */
export const solidVertex = `${HEAD}
in vec3 position; in vec3 normal; in vec3 category;
uniform mat4 clip_from_source;
out vec3 place; out vec3 across; out vec3 colour;
void main() {
  place = position; across = normal; colour = category;
  gl_Position = clip_from_source * vec4(position, 1.0);
}`;

export const solidFacts = `${HEAD}${CUT}
in vec3 place; in vec3 across; in vec3 colour;
uniform vec3 eye;
out vec4 seen;
void main() {
  if (is_cut(place)) discard;
  float lit = 0.5 + 0.5 * abs(dot(normalize(across), normalize(eye - place)));
  seen = vec4(colour * lit, 1.0);
}`;

/** What a surface is, nearest first: its exitance, or a colour for its zone or its stage. */
export const surfaceFacts = `${HEAD}${CUT}
in vec3 place; in vec4 exitance; flat in vec3 across; flat in vec3 colour;
uniform vec3 eye; uniform float scale; uniform bool is_exitance;
out vec4 seen;
void main() {
  if (is_cut(place)) discard;
  float lit = 0.55 + 0.45 * abs(dot(across, normalize(eye - place)));
  seen = is_exitance ? exitance / scale : vec4(colour * lit, 1.0);
}`;

/** A rectangle over everything; `way` goes from the eye through each pixel. */
export const everywhere = `${HEAD}
uniform mat4 source_from_clip; uniform vec3 eye;
out vec3 far;
void main() {
  vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
  vec4 end = source_from_clip * vec4(corner, 1.0, 1.0);
  far = end.xyz / end.w;
  gl_Position = vec4(corner, 0.0, 1.0);
}`;

/** L = q ∫ j ds along the line of sight, by section 4: j is trilinear within lit cells, 0 elsewhere. While it moves, j is read from a
 * smaller table that the texture unit itself interpolates. */
export const volumeLight = (isMoving) => `${HEAD}${DISTRIBUTION}${CUT}
in vec3 far;
uniform vec3 eye; uniform float scale;
uniform sampler3D j_nodes; uniform sampler3D lit_cells;
uniform vec3 least; uniform vec3 pitch; uniform ivec3 cells; uniform int steps;
out vec4 seen;
vec4 node(ivec3 at) { return texelFetch(j_nodes, at, 0); }
vec4 j_at(vec3 p) {
  ivec3 c = clamp(ivec3(floor(p)), ivec3(0), cells - 1);
  if (texelFetch(lit_cells, c, 0).r < 0.5) return vec4(0.0);
  ${isMoving ? "return texture(j_nodes, (p + 0.5) / vec3(cells + 1));" : ""}
  vec3 f = p - vec3(c);
  vec4 y0 = mix(mix(node(c), node(c + ivec3(1, 0, 0)), f.x), mix(node(c + ivec3(0, 1, 0)), node(c + ivec3(1, 1, 0)), f.x), f.y);
  vec4 y1 = mix(mix(node(c + ivec3(0, 0, 1)), node(c + ivec3(1, 0, 1)), f.x), mix(node(c + ivec3(0, 1, 1)), node(c + ivec3(1, 1, 1)), f.x), f.y);
  return mix(y0, y1, f.z);
}
void main() {
  vec3 way = normalize(far - eye);
  vec3 inverse = 1.0 / (way + vec3(equal(way, vec3(0.0))) * 1e-12);
  vec3 a = (least - eye) * inverse;
  vec3 b = (least + pitch * vec3(cells) - eye) * inverse;
  vec3 low = min(a, b); vec3 high = max(a, b);
  float from = max(max(low.x, low.y), max(low.z, 0.0));
  float to = min(high.x, min(high.y, high.z));
  seen = vec4(0.0);
  for (int k = 0; k < 3; k++) {
    float slope = dot(cuts[k].xyz, way);
    float end = (cuts[k].w - dot(cuts[k].xyz, eye)) / (slope == 0.0 ? 1e-12 : slope);
    if (slope > 0.0) to = min(to, end); else if (slope < 0.0) from = max(from, end); else if (dot(cuts[k].xyz, eye) > cuts[k].w) return;
  }
  if (to <= from) return;
  float step_mm = (to - from) / float(steps);
  for (int i = 0; i < steps; i++) seen += j_at((eye + way * (from + (float(i) + 0.5) * step_mm) - least) / pitch);
  seen *= step_mm * q_of(0, nodes_of(-way)) / scale;
}`;

/** Shows what was summed. `way` is "false": colours of one component (1: Y, 3: radiant); "true": true colour; "plain": colours as they are. */
export const shown = (way) => `${HEAD}
uniform sampler2D summed; uniform sampler2D colours;
uniform int component; uniform float greatest; uniform float decades; uniform mat3 rgb_from_xyz;
out vec4 pixel;
vec3 encoded(vec3 c) { return mix(12.92 * c, 1.055 * pow(max(c, 1e-9), vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c)); }
void main() {
  vec4 light = texelFetch(summed, ivec2(gl_FragCoord.xy), 0);
  ${SHOWN[way]}
}`;

const SHOWN = {
  plain: "pixel = vec4(light.a > 0.0 ? light.rgb : vec3(0.0235, 0.0275, 0.0588), 1.0);",
  true: `vec3 c = rgb_from_xyz * light.xyz / greatest;
  float grey = light.y / greatest;
  float least = min(c.r, min(c.g, c.b));
  // Colours outside of the screen's are paled until they are within, at their own luminance.
  if (least < 0.0 && grey > 0.0) c = mix(vec3(grey), c, grey / (grey - least));
  pixel = vec4(encoded(clamp(c, 0.0, 1.0)), 1.0);`,
  false: `float value = (component == 1 ? light.y : light.a) / greatest;
  float where = decades > 0.0 ? 1.0 + log(max(value, 1e-12)) / 2.302585093 / decades : value;
  pixel = texelFetch(colours, ivec2(int(clamp(where, 0.0, 1.0) * 255.0 + 0.5), 0), 0);`,
};
