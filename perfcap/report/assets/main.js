// Puts the page together.

import { Toggle, setUpKeys, setUpTransport } from "./controls.js";
import { readData } from "./data.js";
import { addTexture, makeScene, makeViews, setFailed, setReady, setUpCharts, setUpFullscreen, setUpViews, takeBody } from "./panels.js";
import { Player } from "./player.js";
import { openGraphics } from "./renderer.js";
import { setUpTheme } from "./theme.js";

const byId = (id) => document.getElementById(id);

/** Buttons of the 3D view; gives what keys do. */
function setUpScene(scene, views, people) {
  const toggle = (name) => new Toggle(`toggle-${name}`, (on) => scene.set({ [name]: on }));
  const [texture, wireframe, skeleton, follow, cameras] = ["texture", "wireframe", "skeleton", "follow", "cameras"].map(toggle);
  scene.cameras = views?.cameras() ?? [];
  if (scene.cameras.length === 0) cameras.disable("The capture's cameras were not found.");
  if (!people.some((person) => person.texture)) {
    texture.set(false);
    texture.disable("The actor has no texture.");
  }
  const kinds = [...document.querySelectorAll("input[name=surface]")];
  const choose = (kind) => {
    kinds.forEach((input) => { input.checked = input.value === kind; });
    scene.set({ kind });
  };
  kinds.forEach((input) => input.addEventListener("change", () => choose(input.value)));
  const plain = scene.bodies.every((body) => body.surface === null);
  if (plain) {
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
  const other = () => choose(scene.show.kind === "captured" || plain ? "skinned" : "captured");
  return {
    s: other,
    t: () => texture.flip(),
    w: () => wireframe.flip(),
    k: () => skeleton.flip(),
    f: () => follow.flip(),
    c: () => cameras.flip(),
    1: () => look("front"),
    2: () => look("side"),
    3: () => look("back"),
    4: () => look("camera"),
  };
}

/** What others may use from the browser's console, and tests do. */
function publish(player, bodies) {
  const vertices = (frame, kind, person = 0) => {
    const body = bodies[person];
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
  // several people have names of their own for what a page of one has without
  const people = data.people ?? [data];
  const prefix = (number) => (data.people ? `p${number + 1}-` : "");
  const taken = [];
  for (const [number, person] of people.entries()) taken.push(await takeBody(person, prefix(number)));
  const player = new Player(data.frames, data.rate, data.opening);
  const scene = makeScene("scene", graphics, taken, data);
  const views = makeViews(taken.map(({ arrays }) => arrays), data, player);
  const parts = [scene, views].filter((part) => part !== null);
  parts.forEach((part) => part.setFrame(player.frame));
  player.addEventListener("frame", () => parts.forEach((part) => part.setFrame(player.frame)));
  setUpTransport(player, data);
  const drawLater = setUpCharts(data, player);
  byId("look-camera").disabled = true;
  const onOpen = () => {
    byId("look-camera").disabled = views.camera() === null;
    scene?.setView(views.current);
    if (scene?.camera) scene.setCamera(views.camera());
  };
  const letters = {
    v: setUpFullscreen(byId("full")),
    ...(scene ? setUpScene(scene, views, people) : {}),
    ...(views ? setUpViews(views, data, onOpen) : {}),
  };
  setUpKeys(player, letters);
  setUpTheme(byId("theme"), byId("theme-name"), () => parts.forEach((part) => part.invalidate()));
  if (scene) {
    for (const [number, person] of people.entries()) await addTexture(scene, person, prefix(number), number);
    byId("scene-message").hidden = true;
    scene.start();
  }
  publish(player, taken.map(({ body }) => body));
  await setReady();
  setTimeout(drawLater); // below what is seen first
}

main().catch((error) => {
  setFailed("scene-message", error);
  throw error;
});
