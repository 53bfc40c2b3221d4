// Shader programs. All light is linear: textures are decoded from sRGB, the last step encodes it.
// (Textures of an sRGB format would do the first in hardware, but are slow to fill without one.)

const HEAD = `#version 300 es
precision highp float;
precision highp sampler2DShadow;
`;

const TONE = `
vec3 decode(vec3 c) {
  return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c));
}
vec3 encode(vec3 c) {
  c = clamp(c, 0.0, 1.0);
  return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c));
}
`;

// Share of the sun that reaches a point, blurred over a few texels of the shadow map.
const SHADOW = `
uniform sampler2DShadow shadowMap;
float sunlit(vec4 at, float bias, float reach) {
  vec3 p = at.xyz / at.w * 0.5 + 0.5;
  if (any(lessThan(p, vec3(0.0))) || any(greaterThan(p, vec3(1.0)))) return 1.0;
  float sum = 0.0;
  float size = reach / float(textureSize(shadowMap, 0).x);
  for (int i = -1; i <= 1; i += 1)
    for (int j = -1; j <= 1; j += 1)
      sum += texture(shadowMap, vec3(p.xy + size * vec2(i, j), p.z - bias));
  return sum / 9.0;
}
`;

export const DEPTH = {
  vertex: `${HEAD}
layout(location = 0) in vec3 position;
uniform mat4 toLight;
void main() { gl_Position = toLight * vec4(position, 1.0); }`,
  fragment: `${HEAD}
void main() {}`,
};

export const SKIN = {
  vertex: `${HEAD}
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
uniform mat4 stage, toScreen, toLight;
out vec3 place, facing;
out vec2 texel;
out vec4 lit;
void main() {
  vec4 p = stage * vec4(position, 1.0);
  place = p.xyz;
  facing = mat3(stage) * normal;
  texel = uv;
  lit = toLight * vec4(position, 1.0);
  gl_Position = toScreen * p;
}`,
  fragment: `${HEAD}${TONE}${SHADOW}
in vec3 place, facing;
in vec2 texel;
in vec4 lit;
uniform sampler2D image;
uniform bool textured;
uniform vec3 eye, sun;
out vec4 color;
void main() {
  vec3 toEye = normalize(eye - place);
  vec3 n = normalize(facing);
  if (!gl_FrontFacing) n = -n;
  vec3 albedo = textured ? decode(texture(image, texel).rgb) : vec3(0.56, 0.55, 0.53);
  float direct = max(dot(n, sun), 0.0) * sunlit(lit, 0.0035, 1.4);
  float up = 0.5 + 0.5 * n.y;
  vec3 light = vec3(1.30, 1.22, 1.10) * direct
    + mix(vec3(0.17, 0.16, 0.15), vec3(0.46, 0.49, 0.54), up)
    + vec3(0.20) * max(dot(n, toEye), 0.0);
  float shine = pow(max(dot(n, normalize(sun + toEye)), 0.0), 28.0);
  float rim = pow(1.0 - max(dot(n, toEye), 0.0), 3.0) * up;
  vec3 c = albedo * light + 0.05 * shine * direct + 0.06 * rim;
  color = vec4(encode(c / (1.0 + 0.18 * c)), 1.0);
}`,
};

export const WIRE = {
  vertex: `${HEAD}
layout(location = 0) in vec3 position;
uniform mat4 stage, toScreen;
void main() {
  gl_Position = toScreen * (stage * vec4(position, 1.0));
  gl_Position.z -= 0.0006 * gl_Position.w;
}`,
  fragment: `${HEAD}
uniform vec4 ink;
out vec4 color;
void main() { color = ink; }`,
};

export const GROUND = {
  vertex: `${HEAD}
layout(location = 0) in vec2 corner;
uniform mat4 toScreen, toLight;
uniform vec3 middle;
uniform float reach;
out vec3 place;
out vec4 lit;
void main() {
  place = vec3(middle.x + reach * corner.x, 0.0, middle.z + reach * corner.y);
  lit = toLight * vec4(place, 1.0);
  gl_Position = toScreen * vec4(place, 1.0);
}`,
  fragment: `${HEAD}${SHADOW}
in vec3 place;
in vec4 lit;
uniform vec3 middle, line;
uniform float reach, depth;
out vec4 color;
float grid(vec2 at, float width) {
  vec2 wide = fwidth(at);
  vec2 off = abs(fract(at - 0.5) - 0.5) / max(wide, 1e-6);
  return (1.0 - min(min(off.x, off.y) / width, 1.0)) * (1.0 - smoothstep(0.1, 0.5, max(wide.x, wide.y)));
}
void main() {
  float far = length(place.xz - middle.xz) / reach;
  float fade = 1.0 - smoothstep(0.25, 1.0, far);
  float lines = max(0.55 * grid(place.xz, 1.2), 0.22 * grid(4.0 * place.xz, 1.0));
  float dark = (1.0 - sunlit(lit, 0.002, 2.0)) * depth;
  float ink = lines * fade;
  // shadow over lines: black with its share, the line's colour with its own
  float alpha = ink + dark - ink * dark;
  color = vec4(line * ink * (1.0 - dark), alpha);
}`,
};

/** Start to compile and link a program; browsers do it in the background until it is asked for. */
export function startProgram(gl, source) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, source.vertex], [gl.FRAGMENT_SHADER, source.fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  return program;
}

/** A started program with its uniforms by name. */
export function finishProgram(gl, program) {
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
    const logs = gl.getAttachedShaders(program).map((shader) => gl.getShaderInfoLog(shader));
    throw new Error([gl.getProgramInfoLog(program), ...logs].join("\n"));
  }
  const uniforms = {};
  for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i += 1) {
    const { name } = gl.getActiveUniform(program, i);
    uniforms[name] = gl.getUniformLocation(program, name);
  }
  return { program, uniforms };
}
