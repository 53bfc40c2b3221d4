// Draws people on a ground with WebGL 2: shadow map, meshes, wireframes, ground.

import { lookAt, multiply, normalize, orthographic } from "./matrix.js";
import { DEPTH, GROUND, SKIN, WIRE, finishProgram, startProgram } from "./shaders.js";

const SHADOW_SIDE = 1024; // texels
const REACH = 5; // m of ground around the person
const SUN = normalize([-0.55, 1.0, 0.75]); // above, ahead, from the person's right

/** WebGL and programs on their way, to be asked for early; null where the browser has none. */
export function openGraphics(canvas) {
  const gl = canvas.getContext("webgl2", { antialias: true, alpha: true });
  return gl === null ? null : { gl, programs: [SKIN, DEPTH, WIRE, GROUND].map((source) => startProgram(gl, source)) };
}

/** One person's mesh and texture. */
class Figure {
  constructor(gl, body) {
    this.gl = gl;
    this.body = body;
    this.spread = new Float32Array(6 * body.welded.length);
    this.makeMesh();
    this.image = this.makeImage();
    this.edges = null;
    this.hasImage = false;
  }

  makeMesh() {
    const { gl, body } = this;
    this.mesh = gl.createVertexArray();
    gl.bindVertexArray(this.mesh);
    this.vertices = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.vertices);
    gl.bufferData(gl.ARRAY_BUFFER, this.spread.byteLength, gl.DYNAMIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 24, 0);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribPointer(1, 3, gl.FLOAT, false, 24, 12);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, body.uv, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(2);
    gl.vertexAttribPointer(2, 2, gl.FLOAT, false, 0, 0);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, body.faces, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
  }

  makeImage() {
    const { gl } = this;
    const image = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, image);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4).fill(200));
    return image;
  }

  /** Use a loaded image as the texture; its first row is at v = 0, as glTF has it. */
  setTexture(picture) {
    const { gl } = this;
    gl.bindTexture(gl.TEXTURE_2D, this.image);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, picture);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    for (const wrap of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) {
      gl.texParameteri(gl.TEXTURE_2D, wrap, gl.REPEAT);
    }
    this.hasImage = true;
  }

  /** Take over the body's pose. */
  upload() {
    this.body.spread(this.spread);
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, this.vertices);
    this.gl.bufferSubData(this.gl.ARRAY_BUFFER, 0, this.spread);
  }

  drawFaces() {
    const { gl } = this;
    gl.bindVertexArray(this.mesh);
    gl.drawElements(gl.TRIANGLES, this.body.faces.length, gl.UNSIGNED_INT, 0);
    gl.bindVertexArray(null);
  }

  drawEdges() {
    const { gl } = this;
    if (this.edges === null) this.makeEdges();
    gl.bindVertexArray(this.edges.array);
    gl.drawElements(gl.LINES, this.edges.count, gl.UNSIGNED_INT, 0);
    gl.bindVertexArray(null);
  }

  makeEdges() {
    const { gl } = this;
    const pairs = this.body.edges();
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.vertices);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 24, 0);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, pairs, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    this.edges = { array, count: pairs.length };
  }
}

export class Renderer {
  /** `stage` moves the world so that y is up, the ground at 0, and people face z. */
  constructor(canvas, graphics, bodies, stage) {
    const { gl, programs } = graphics;
    this.canvas = canvas;
    this.gl = gl;
    this.stage = stage;
    [this.skin, this.depth, this.wire, this.ground] = programs.map((program) => finishProgram(gl, program));
    this.figures = bodies.map((body) => new Figure(gl, body));
    this.makeGround();
    this.makeShadow();
  }

  /** Take over the bodies' poses. */
  upload() {
    this.figures.forEach((figure) => figure.upload());
  }

  makeGround() {
    const { gl } = this;
    this.plane = gl.createVertexArray();
    gl.bindVertexArray(this.plane);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    gl.bindVertexArray(null);
  }

  makeShadow() {
    const { gl } = this;
    this.shadow = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.shadow);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, SHADOW_SIDE, SHADOW_SIDE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE);
    for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
      gl.texParameteri(gl.TEXTURE_2D, filter, gl.LINEAR);
    }
    for (const wrap of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) {
      gl.texParameteri(gl.TEXTURE_2D, wrap, gl.CLAMP_TO_EDGE);
    }
    this.shadowTarget = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowTarget);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, this.shadow, 0);
    gl.drawBuffers([gl.NONE]);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /** Draw; `look` has eye and toScreen, `reach` (m) holds everybody, `style` says what and how. */
  draw(look, middle, reach, style) {
    const light = [0, 1, 2].map((k) => middle[k] + 4 * SUN[k]);
    const side = Math.max(1.6, reach);
    const view = multiply(orthographic(side, 0.5 - Math.max(0, side - 1.6), 8 + side - 1.6), lookAt(light, middle, [0, 0, 1]));
    const toLight = multiply(view, this.stage);
    this.drawShadow(toLight);
    const { gl, canvas } = this;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, this.shadow);
    gl.activeTexture(gl.TEXTURE0);
    this.drawSkin(look, toLight, style);
    if (style.wireframe) this.drawWire(look, style);
    this.drawGround(look, view, middle, style);
  }

  drawShadow(toLight) {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowTarget);
    gl.viewport(0, 0, SHADOW_SIDE, SHADOW_SIDE);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(this.depth.program);
    gl.uniformMatrix4fv(this.depth.uniforms.toLight, false, toLight);
    this.figures.forEach((figure) => figure.drawFaces());
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  drawSkin(look, toLight, style) {
    const { gl } = this;
    const { program, uniforms } = this.skin;
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.stage, false, this.stage);
    gl.uniformMatrix4fv(uniforms.toScreen, false, look.toScreen);
    gl.uniformMatrix4fv(uniforms.toLight, false, toLight);
    gl.uniform3fv(uniforms.eye, look.eye);
    gl.uniform3fv(uniforms.sun, SUN);
    gl.uniform1i(uniforms.image, 0);
    gl.uniform1i(uniforms.shadowMap, 1);
    for (const figure of this.figures) {
      gl.bindTexture(gl.TEXTURE_2D, figure.image);
      gl.uniform1i(uniforms.textured, style.texture && figure.hasImage ? 1 : 0);
      figure.drawFaces();
    }
  }

  drawWire(look, style) {
    const { gl } = this;
    gl.useProgram(this.wire.program);
    gl.uniformMatrix4fv(this.wire.uniforms.stage, false, this.stage);
    gl.uniformMatrix4fv(this.wire.uniforms.toScreen, false, look.toScreen);
    gl.uniform4fv(this.wire.uniforms.ink, style.ink);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    this.figures.forEach((figure) => figure.drawEdges());
    gl.disable(gl.BLEND);
  }

  drawGround(look, toLight, middle, style) {
    const { gl } = this;
    const { program, uniforms } = this.ground;
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.toScreen, false, look.toScreen);
    gl.uniformMatrix4fv(uniforms.toLight, false, toLight);
    gl.uniform3fv(uniforms.middle, middle);
    gl.uniform3fv(uniforms.line, style.line);
    gl.uniform1f(uniforms.reach, REACH);
    gl.uniform1f(uniforms.depth, style.shadow);
    gl.uniform1i(uniforms.shadowMap, 1);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    gl.bindVertexArray(this.plane);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.bindVertexArray(null);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }
}
