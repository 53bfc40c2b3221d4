// Puts the page together.

import { Body } from "./body.js";
import { Chart, drawn } from "./charts.js";
import { Toggle, setUpKeys, setUpTransport } from "./controls.js";
import { readData, takeArrays, takeBytes } from "./data.js";
import { Footage } from "./footage.js";
import { Player } from "./player.js";
import { openGraphics } from "./renderer.js";
import { Scene } from "./scene.js";
import { setUpTheme } from "./theme.js";
import { Views } from "./views.js";

const byId = (id) => document.getElementById(id);

/** The 3D view; null, with a word on the page, where the browser has none. */
function makeScene(graphics, body, arrays, data) {
  if (graphics === null) {
    byId("scene-message").textContent = "This browser shows no WebGL 2. Everything else on this page works.";
    return null;
  }
  return new Scene(byId("scene"), byId("scene-marks"), graphics, body, arrays, data);
}

async function addTexture(scene, data) {
  if (!data.texture) return;
  const picture = new Image();
  picture.src = URL.createObjectURL(new Blob([takeBytes("texture")], { type: data.texture.type }));
  await picture.decode();
  URL.revokeObjectURL(picture.src);
  scene.renderer.setTexture(picture);
}

/** Buttons of the 3D view; gives what keys do. */
function setUpScene(scene, body, views, data) {
  const toggle = (name) => new Toggle(`toggle-${name}`, (on) => scene.set({ [name]: on }));
  const [texture, wireframe, skeleton, follow] = ["texture", "wireframe", "skeleton", "follow"].map(toggle);
  if (!data.texture) {
    texture.set(false);
    texture.disable("The actor has no texture.");
  }
  const kinds = [...document.querySelectorAll("input[name=surface]")];
  const choose = (kind) => {
    kinds.forEach((input) => { input.checked = input.value === kind; });
    scene.set({ kind });
  };
  kinds.forEach((input) => input.addEventListener("change", () => choose(input.value)));
  if (body.surface === null) {
    choose("skinned");
    kinds[0].disabled = true;
    kinds[0].parentElement.title = "This page holds no captured surface.";
  }
  const looks = [...document.querySelectorAll("[data-look]")];
  const look = (name) => {
    const camera = name === "camera" ? views?.camera() ?? null : null;
    if (name === "camera" && camera === null) return;
    scene.setCamera(camera);
    if (camera === null) scene.orbit.look(name);
  };
  looks.forEach((button) => button.addEventListener("click", () => look(button.dataset.look)));
  scene.onCamera = (filmed) => byId("look-camera").setAttribute("aria-pressed", String(filmed));
  const other = () => choose(scene.show.kind === "captured" || body.surface === null ? "skinned" : "captured");
  return {
    s: other,
    t: () => texture.flip(),
    w: () => wireframe.flip(),
    k: () => skeleton.flip(),
    f: () => follow.flip(),
    1: () => look("front"),
    2: () => look("side"),
    3: () => look("back"),
    4: () => look("camera"),
  };
}

/** The video and what is drawn over it; null where there is none. */
function makeViews(arrays, data, player) {
  if (data.views.length === 0) {
    byId("video-pane").hidden = true;
    return null;
  }
  const message = byId("video-message");
  const footage = new Footage(byId("video"), player, () => {
    message.hidden = false;
    message.textContent = "This browser cannot play the video (H.264).";
    byId("video").hidden = true;
    player.follow(null);
  });
  const elements = { screen: byId("video-screen"), fit: byId("video-fit"), video: byId("video"), marks: byId("video-marks") };
  return new Views(elements, arrays, data, footage);
}

/** Buttons of the video; gives what keys do. */
function setUpViews(views, scene, data) {
  const names = { outline: "o", mask: "m", joints: "j", detected: "d" };
  const toggles = Object.keys(names).map((name) => [name, new Toggle(`toggle-${name}`, (on) => views.set({ [name]: on }))]);
  const open = (index) => {
    views.open(index);
    const there = views.available();
    toggles.forEach(([name, toggle]) => toggle.disable(there[name] ? "" : "There is nothing of this kind."));
    byId("look-camera").disabled = views.camera() === null;
    if (scene?.camera) scene.setCamera(views.camera());
  };
  const pick = byId("view");
  data.views.forEach((view, index) => pick.append(new Option(view.name, index)));
  byId("view-pick").hidden = data.views.length < 2;
  pick.addEventListener("change", () => open(Number(pick.value)));
  open(0);
  return Object.fromEntries(toggles.map(([name, toggle]) => [names[name], () => toggle.flip()]));
}

/** Charts, and the marks above the slider. */
function setUpCharts(data, player) {
  const charts = data.charts.map((chart) => new Chart(chart, data, player));
  byId("charts").append(...charts.map((chart) => chart.element));
  byId("frames").hidden = charts.length === 0;
  player.addEventListener("frame", () => charts.forEach((chart) => chart.update()));
  const lane = byId("lane");
  lane.setAttribute("viewBox", `-0.5 0 ${data.frames} 1`);
  for (const mark of data.marks) {
    const place = { x: mark.start - data.first - 0.5, width: mark.stop - mark.start, y: 0, height: 1 };
    lane.append(drawn("rect", { class: `mark-${mark.kind}`, ...place }));
  }
}

/** What others may use from the browser's console, and tests do. */
function publish(player, body) {
  const vertices = (frame, kind) => {
    if (kind === "captured" && body.surface !== null) {
      const size = body.positions.length;
      const { levels, origin, step } = body.surface;
      return [...levels.subarray(frame * size, frame * size + size)].map((level, i) => origin[i % 3] + step * level);
    }
    const out = new Float32Array(body.positions.length);
    body.skin.pose(frame, out);
    return [...out];
  };
  globalThis.perfcap = Object.freeze({ player, vertices });
}

async function main() {
  const data = readData();
  const graphics = openGraphics(byId("scene"));
  const arrays = await takeArrays("model", data.arrays);
  const player = new Player(data.frames, data.rate);
  const body = new Body(arrays);
  if (data.surface) {
    const surface = await takeArrays("surface", data.surface.arrays);
    body.addSurface(surface, data.surface.origin, data.surface.step);
  }
  const scene = makeScene(graphics, body, arrays, data);
  const views = makeViews(arrays, data, player);
  const parts = [scene, views].filter((part) => part !== null);
  player.addEventListener("frame", () => parts.forEach((part) => part.setFrame(player.frame)));
  setUpTransport(player, data);
  setUpCharts(data, player);
  byId("look-camera").disabled = true;
  const letters = {
    ...(scene ? setUpScene(scene, body, views, data) : {}),
    ...(views ? setUpViews(views, scene, data) : {}),
  };
  setUpKeys(player, letters);
  setUpTheme(byId("theme"), byId("theme-name"), () => parts.forEach((part) => part.invalidate()));
  if (scene) {
    await addTexture(scene, data);
    byId("scene-message").hidden = true;
    scene.start();
  }
  publish(player, body);
  // a picture was asked for: it is drawn in the next frame, and shown before the one after
  await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  document.documentElement.dataset.state = "ready";
  document.documentElement.dataset.ready = performance.now().toFixed(0);
}

main().catch((error) => {
  byId("scene-message").textContent = `The page cannot be unpacked: ${error.message}`;
  document.documentElement.dataset.state = "failed";
  throw error;
});
