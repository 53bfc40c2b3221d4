// Puts the page of two results together.

import { Toggle, setUpKeys, setUpTransport } from "./controls.js";
import { readData } from "./data.js";
import { addTexture, makeScene, makeViews, setFailed, setReady, setUpCharts, setUpFullscreen, setUpViews, takeBody } from "./panels.js";
import { Player } from "./player.js";
import { openGraphics } from "./renderer.js";
import { setUpTheme } from "./theme.js";

const byId = (id) => document.getElementById(id);

/** Buttons of both 3D views; gives what keys do. */
function setUpScenes(scenes, results) {
  const toggle = (name) => new Toggle(`toggle-${name}`, (on) => scenes.forEach((scene) => scene.set({ [name]: on })));
  const [texture, wireframe, skeleton, follow] = ["texture", "wireframe", "skeleton", "follow"].map(toggle);
  if (!results.some((result) => result.texture)) {
    texture.set(false);
    texture.disable("The actors have no texture.");
  }
  const kinds = [...document.querySelectorAll("input[name=surface]")];
  const choose = (kind) => {
    kinds.forEach((input) => { input.checked = input.value === kind; });
    scenes.forEach((scene) => scene.set({ kind }));
  };
  kinds.forEach((input) => input.addEventListener("change", () => choose(input.value)));
  if (!results.some((result) => result.surface)) {
    choose("skinned");
    kinds[0].disabled = true;
    kinds[0].parentElement.title = "This page holds no captured surface.";
  }
  const look = (name) => scenes[0].orbit.look(name); // the others follow
  document.querySelectorAll("[data-look]").forEach((button) => button.addEventListener("click", () => look(button.dataset.look)));
  return {
    s: () => { if (!kinds[0].disabled) choose(scenes[0].show.kind === "captured" ? "skinned" : "captured"); },
    t: () => texture.flip(),
    w: () => wireframe.flip(),
    k: () => skeleton.flip(),
    f: () => follow.flip(),
    1: () => look("front"),
    2: () => look("side"),
    3: () => look("back"),
  };
}

/** Two people of one size on the screen, seen from the same side. */
function link(scenes) {
  const half = (key) => Math.max(...scenes.map((scene) => scene.framing.half[key]));
  const common = { height: half("height"), width: half("width") };
  scenes.forEach((scene) => { scene.orbit.half = common; });
  for (const scene of scenes) {
    scene.orbit.onAim = () => {
      for (const other of scenes) {
        if (other === scene) continue;
        Object.assign(other.orbit.goal, scene.orbit.goal);
        other.invalidate();
      }
    };
  }
}

async function main() {
  const data = readData();
  const graphics = ["scene", "scene-b"].map((id) => openGraphics(byId(id)));
  const [a, b] = data.results;
  const taken = [await takeBody(a, "a-"), await takeBody(b, "b-")];
  const player = new Player(data.frames, data.rate, data.opening);
  const made = taken.map((person, i) => makeScene(i === 0 ? "scene" : "scene-b", graphics[i], [person], data.results[i]));
  const scenes = made.filter((scene) => scene !== null);
  const views = makeViews([taken[0].arrays], a, player);
  const parts = [...scenes, views].filter((part) => part !== null);
  parts.forEach((part) => part.setFrame(player.frame));
  player.addEventListener("frame", () => parts.forEach((part) => part.setFrame(player.frame)));
  setUpTransport(player, data);
  const drawLater = setUpCharts(data, player);
  const letters = {
    v: setUpFullscreen(byId("full")),
    ...(scenes.length === 2 ? setUpScenes(scenes, data.results) : {}),
    ...(views ? setUpViews(views, a, () => {}) : {}),
  };
  setUpKeys(player, letters);
  setUpTheme(byId("theme"), byId("theme-name"), () => parts.forEach((part) => part.invalidate()));
  if (scenes.length === 2) {
    link(scenes);
    await addTexture(scenes[0], a, "a-");
    await addTexture(scenes[1], b, "b-");
    for (const id of ["scene-message", "scene-b-message"]) byId(id).hidden = true;
    scenes.forEach((scene) => scene.start());
  }
  const sides = () => scenes.map((scene) => ({ ...scene.orbit.goal })); // for tests
  globalThis.perfcap = Object.freeze({ player, sides });
  await setReady();
  setTimeout(drawLater); // below what is seen first
}

main().catch((error) => {
  setFailed("scene-message", error);
  throw error;
});
