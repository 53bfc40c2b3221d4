// Parts that pages are put together from: bodies, 3D views, the video, charts.

import { Body } from "./body.js";
import { Chart, drawn } from "./charts.js";
import { Toggle } from "./controls.js";
import { downloadCharts } from "./csv.js";
import { takeArrays, takeBytes } from "./data.js";
import { Footage } from "./footage.js";
import { Scene } from "./scene.js";
import { Views } from "./views.js";

const byId = (id) => document.getElementById(id);

/** Arrays and body of a result, whose blobs have names that start with `prefix`. */
export async function takeBody(data, prefix) {
  const arrays = await takeArrays(`${prefix}model`, data.arrays);
  const body = new Body(arrays);
  if (data.surface) {
    const surface = await takeArrays(`${prefix}surface`, data.surface.arrays);
    body.addSurface(surface, data.surface.origin, data.surface.step);
  }
  return { arrays, body };
}

/** The 3D view in the canvas `id`; null, with a word on the page, where the browser has none. */
export function makeScene(id, graphics, people, data) {
  if (graphics === null) {
    byId(`${id}-message`).textContent = "This browser shows no WebGL 2. Everything else on this page works.";
    return null;
  }
  return new Scene(byId(id), byId(`${id}-marks`), graphics, people, data);
}

/** Give the person `number` of a scene their texture. */
export async function addTexture(scene, data, prefix, number = 0) {
  if (!data.texture) return;
  const picture = new Image();
  const file = new Blob([takeBytes(`${prefix}texture`)], { type: data.texture.type });
  picture.src = URL.createObjectURL(file);
  await picture.decode();
  URL.revokeObjectURL(picture.src);
  scene.renderer.figures[number].setTexture(picture);
}

/** The video and what is drawn over it of each person's arrays; null where there is none. */
export function makeViews(everybody, data, player) {
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
  return new Views(elements, everybody, data, footage);
}

/** Buttons of the video; gives what keys do. `onOpen` is told when another view is shown. */
export function setUpViews(views, data, onOpen) {
  const names = { outline: "o", mask: "m", joints: "j", detected: "d" };
  const toggles = Object.keys(names).map((name) => [name, new Toggle(`toggle-${name}`, (on) => views.set({ [name]: on }))]);
  const open = (index) => {
    views.open(index);
    const there = views.available();
    toggles.forEach(([name, toggle]) => toggle.disable(there[name] ? "" : "There is nothing of this kind."));
    onOpen(index);
  };
  const pick = byId("view");
  data.views.forEach((view, index) => pick.append(new Option(view.name, index)));
  byId("view-pick").hidden = data.views.length < 2;
  pick.addEventListener("change", () => open(Number(pick.value)));
  open(0);
  return Object.fromEntries(toggles.map(([name, toggle]) => [names[name], () => toggle.flip()]));
}

/** Charts and the marks above the slider; gives what makes those that may come later. */
export function setUpCharts(data, player) {
  const lane = byId("lane");
  lane.setAttribute("viewBox", `-0.5 0 ${data.frames} 1`);
  for (const mark of data.marks) {
    const place = { x: mark.start - data.first - 0.5, width: mark.stop - mark.start, y: 0, height: 1 };
    lane.append(drawn("rect", { class: `mark-${mark.kind}`, ...place }));
  }
  fillGroup("frames", "curves", data, player)();
  return fillGroup("angles", "angles", data, player);
}

/** A part of the page with charts, and their file; gives what draws them. */
function fillGroup(group, name, data, player) {
  const chosen = data.charts.filter((chart) => chart.group === group);
  byId(group).hidden = chosen.length === 0;
  byId(`${group}-csv`).addEventListener("click", () => downloadCharts(data, chosen, name));
  return () => {
    const charts = chosen.map((chart) => new Chart(chart, data, player));
    const place = byId(`${group}-charts`);
    place.append(...charts.map((chart) => chart.element));
    const update = () => { if (place.offsetParent !== null) charts.forEach((chart) => chart.update()); };
    player.addEventListener("frame", update);
    byId(group).querySelector("details")?.addEventListener("toggle", update);
  };
}

/** The person and the controls alone on the screen, where the browser lets pages do that. */
export function setUpFullscreen(button) {
  const root = document.documentElement;
  const show = (full) => {
    root.toggleAttribute("data-full", full);
    button.setAttribute("aria-pressed", String(full));
  };
  const flip = async () => {
    const full = !root.hasAttribute("data-full");
    show(full); // fills the window where there is no more to be had
    try {
      if (full) await root.requestFullscreen?.();
      else if (document.fullscreenElement !== null) await document.exitFullscreen();
    } catch {
      // an embedding page does not allow it
    }
  };
  button.addEventListener("click", flip);
  document.addEventListener("fullscreenchange", () => show(document.fullscreenElement !== null));
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape" && root.hasAttribute("data-full") && document.fullscreenElement === null) show(false);
  });
  return flip;
}

/** Everything is there: for tests, and to know how long it took. */
export async function setReady() {
  // a picture was asked for: it is drawn in the next frame, and shown before the one after
  await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  document.documentElement.dataset.state = "ready";
  document.documentElement.dataset.ready = performance.now().toFixed(0);
}

export function setFailed(id, error) {
  byId(id).textContent = `The page cannot be unpacked: ${error.message}`;
  document.documentElement.dataset.state = "failed";
}
