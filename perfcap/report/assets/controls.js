// Buttons, the slider, and keys.

const SPEEDS = [0.1, 0.25, 0.5, 1, 2];
const FORMS = "input, select, textarea, button, a, summary, [contenteditable]";

function byId(id) {
  return document.getElementById(id);
}

/** A button that is on or off. */
export class Toggle {
  constructor(id, onChange) {
    this.button = byId(id);
    this.onChange = onChange;
    this.button.addEventListener("click", () => this.flip());
  }

  get on() {
    return this.button.getAttribute("aria-pressed") === "true";
  }

  set(on) {
    this.button.setAttribute("aria-pressed", String(on));
    this.onChange(on);
  }

  flip() {
    if (!this.button.disabled) this.set(!this.on);
  }

  /** Cannot be used, for a reason. */
  disable(reason) {
    this.button.disabled = reason !== "";
    this.button.title = reason;
  }
}

/** Play, step, scrub, speed, repeat, and what they show. */
export function setUpTransport(player, data) {
  const scrub = byId("scrub");
  const speed = byId("speed");
  scrub.max = data.frames - 1;
  byId("play").addEventListener("click", () => player.toggle());
  byId("back").addEventListener("click", () => step(player, -1));
  byId("forward").addEventListener("click", () => step(player, 1));
  scrub.addEventListener("input", () => player.seek(Number(scrub.value)));
  speed.addEventListener("change", () => player.setSpeed(Number(speed.value)));
  const loop = new Toggle("loop", (on) => player.setLoop(on));
  const showFrame = () => {
    const time = `${(player.frame / data.rate).toFixed(2)} s`;
    scrub.value = player.frame;
    scrub.setAttribute("aria-valuetext", `frame ${data.first + player.frame}, ${time}`);
    scrub.style.setProperty("--done", `${(100 * player.frame) / Math.max(1, data.frames - 1)}%`);
    byId("frame").textContent = data.first + player.frame;
    byId("time").textContent = time;
  };
  const showState = () => {
    byId("play").setAttribute("aria-label", player.playing ? "Pause" : "Play");
    byId("play-icon").setAttribute("href", player.playing ? "#icon-pause" : "#icon-play");
    speed.value = String(player.speed);
    // while frames rush by, a reader of screens should not be told each of them
    byId("readout").setAttribute("aria-live", player.playing ? "off" : "polite");
  };
  player.addEventListener("frame", showFrame);
  player.addEventListener("state", showState);
  for (const button of document.querySelectorAll("[data-frame]")) {
    button.addEventListener("click", () => {
      player.pause();
      player.seek(Number(button.dataset.frame) - data.first);
    });
  }
  showFrame();
  showState();
  return loop;
}

/** Keys of the page; `letters` maps further ones to what they do. */
export function setUpKeys(player, letters) {
  const moves = {
    Home: () => player.seek(0),
    End: () => player.seek(player.frames - 1),
    "[": () => changeSpeed(player, -1),
    "]": () => changeSpeed(player, 1),
  };
  // what was clicked last does not keep the keyboard: space still plays
  document.addEventListener("mousedown", (event) => {
    if (event.target.closest("button") !== null) event.preventDefault();
  });
  document.addEventListener("change", ({ target }) => {
    if (target.type === "radio" && !target.matches(":focus-visible")) target.blur();
  });
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return;
    const inForm = event.target.closest(FORMS) !== null;
    const typing = event.target.closest("select, textarea, input") !== null;
    if (event.key === " " && !inForm) player.toggle();
    else if (event.key === " " && event.target.id === "scrub") player.toggle();
    else if (event.key === "ArrowLeft" && !typing) step(player, event.shiftKey ? -10 : -1);
    else if (event.key === "ArrowRight" && !typing) step(player, event.shiftKey ? 10 : 1);
    else if (event.key in moves && !(typing && event.key.length > 1)) moves[event.key]();
    else if (event.key.toLowerCase() in letters && !event.target.closest("select")) letters[event.key.toLowerCase()]();
    else return;
    event.preventDefault();
  });
}

function step(player, frames) {
  player.pause();
  player.seek(player.frame + frames);
}

function changeSpeed(player, way) {
  const index = SPEEDS.indexOf(player.speed) + way;
  if (index >= 0 && index < SPEEDS.length) player.setSpeed(SPEEDS[index]);
}
