// What three.js sees in GLB files, in a real browser: vertices at some frames, and a picture.
//
//   node tools/three_sample.mjs CHROMIUM FPS FRAME,FRAME,... FILE.glb OUT.f32 [OUT.png]
//
// Resolves `three` and `playwright-core` from the node_modules of the current folder. OUT.f32 is
// little-endian float32 (frames, vertices, 3) in the world. Exit code 1 on any message of the
// browser's console that is an error.
import { readFileSync, writeFileSync } from "node:fs";
import { createServer } from "node:http";
import { createRequire } from "node:module";
import { extname, join, normalize } from "node:path";

const [chromium, fps, frames, glb, out, picture] = process.argv.slice(2);
const require = createRequire(join(process.cwd(), "anchor.js"));
const { chromium: browserType } = require("playwright-core");
const packages = join(process.cwd(), "node_modules");

const page_text = `<!doctype html><style>body{margin:0}</style>
<script type="importmap">{"imports":{"three":"/three/build/three.module.js",
"three/addons/":"/three/examples/jsm/"}}</script>
<script type="module">
import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
const gltf = await new GLTFLoader().loadAsync("/file.glb");
const scene = new THREE.Scene();
scene.background = new THREE.Color(0x9aa3ad);
scene.add(gltf.scene, new THREE.HemisphereLight(0xffffff, 0x555555, 3));
const renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
renderer.setSize(300, 400);
document.body.append(renderer.domElement);
let mesh = null;
gltf.scene.traverse((o) => { if (o.isMesh) mesh = o; });
const mixer = new THREE.AnimationMixer(gltf.scene);
// a clip that is set to its very end wraps around to its start
for (const clip of gltf.animations) { const a = mixer.clipAction(clip); a.setLoop(THREE.LoopOnce);
  a.clampWhenFinished = true; a.play(); }
window.sample = (time) => {
  for (const clip of gltf.animations) mixer.clipAction(clip).reset();
  mixer.setTime(time);
  gltf.scene.updateMatrixWorld(true);
  const count = mesh.geometry.attributes.position.count;
  const found = new Float32Array(3 * count), point = new THREE.Vector3();
  for (let i = 0; i < count; i++)
    mesh.getVertexPosition(i, point).applyMatrix4(mesh.matrixWorld).toArray(found, 3 * i);
  const box = new THREE.Box3().setFromArray(found);
  const middle = box.getCenter(new THREE.Vector3()), size = box.getSize(point).length();
  const camera = new THREE.PerspectiveCamera(40, 300 / 400, 0.01, 1000);
  camera.position.copy(middle).add(new THREE.Vector3(0.6 * size, 0.3 * size, 1.3 * size));
  camera.lookAt(middle);
  mesh.frustumCulled = false;
  renderer.render(scene, camera);
  let text = "";
  const bytes = new Uint8Array(found.buffer);
  for (let i = 0; i < bytes.length; i += 32768)
    text += String.fromCharCode(...bytes.subarray(i, i + 32768));
  return btoa(text);
};
window.ready = true;
</script>`;

const types = { ".js": "text/javascript", ".glb": "model/gltf-binary" };
const server = createServer((request, response) => {
  if (request.url === "/") return response.setHeader("Content-Type", "text/html").end(page_text);
  try {
    const path = request.url === "/file.glb" ? glb : join(packages, normalize(request.url));
    response.setHeader("Content-Type", types[extname(path)] ?? "application/octet-stream");
    response.end(readFileSync(path));
  } catch {
    response.writeHead(request.url === "/favicon.ico" ? 204 : 404).end();
  }
}).listen(0, "127.0.0.1");
await new Promise((done) => server.once("listening", done));

const browser = await browserType.launch({
  executablePath: chromium,
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
});
const page = await browser.newPage({ viewport: { width: 300, height: 400 } });
let failed = false;
const complain = (text) => { failed = true; console.error(text); };
page.on("console", (message) => { if (message.type() === "error") complain(message.text()); });
page.on("pageerror", (error) => complain(String(error)));
await page.goto(`http://127.0.0.1:${server.address().port}/`);
await page.waitForFunction("window.ready", null, { timeout: 60000 });
const parts = [];
for (const frame of frames.split(",")) {
  const text = await page.evaluate((time) => window.sample(time), Number(frame) / Number(fps));
  parts.push(Buffer.from(text, "base64"));
}
writeFileSync(out, Buffer.concat(parts));
if (picture) await page.screenshot({ path: picture });
await browser.close();
server.close();
process.exit(failed ? 1 : 0);
